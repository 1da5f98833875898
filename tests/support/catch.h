// SPDX-License-Identifier: Apache-2.0
// Hides the differences of Catch2 2.13 and 3; tests use the names of 2.13.
#pragma once

#if JADE_CATCH2_MAJOR >= 3
#include <catch2/catch_all.hpp>
using Catch::Approx;
namespace Catch {
inline auto Contains(const std::string& part) { return Matchers::ContainsSubstring(part); }
using Matchers::EndsWith;
using Matchers::MatcherBase;
using Matchers::StartsWith;
}  // namespace Catch
#else
#include <catch2/catch.hpp>
#endif
