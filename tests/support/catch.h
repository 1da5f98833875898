// SPDX-License-Identifier: Apache-2.0
// The only place that knows which Catch2 is installed: 2.13 (Debian 12, Ubuntu 22.04) or 3.
#pragma once

#if JADE_CATCH2_MAJOR >= 3
#include <catch2/catch_all.hpp>
using Catch::Approx;
#else
#include <catch2/catch.hpp>
#endif
