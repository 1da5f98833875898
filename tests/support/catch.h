// SPDX-License-Identifier: Apache-2.0
// The only place that knows which Catch2 is installed: 2.13 (Debian 12, Ubuntu 22.04) or 3 (Debian
// 13, Ubuntu 24.04). Tests use the names of 2.13.
#pragma once

#if JADE_CATCH2_MAJOR >= 3
#include <catch2/catch_all.hpp>
using Catch::Approx;
namespace Catch {
inline auto Contains(const std::string& part) { return Matchers::ContainsSubstring(part); }
using Matchers::EndsWith;
using Matchers::StartsWith;
}  // namespace Catch
#else
#include <catch2/catch.hpp>
#endif
