// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

namespace jade {

/// "39,280".
std::string grouped(int64_t number);

/// A number for a person: "39,280", "0.25" or "1e-9", with at most `digits` significant digits in a
/// fraction. Without an exponent from 1e-4 up.
std::string readable(double number, int digits = 6);

/// "about 40 s", "about 8 min" or "about 2.5 h".
std::string about_time(double seconds);

}  // namespace jade
