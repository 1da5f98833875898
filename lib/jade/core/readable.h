// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

namespace jade {

/// "39,280".
std::string grouped(int64_t number);

/// "about 40 s", "about 8 min" or "about 2.5 h".
std::string about_time(double seconds);

}  // namespace jade
