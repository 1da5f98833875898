// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace jade {

/// In lower case; letters beyond ASCII stay.
std::string in_small_letters(std::string text);

/// The names as a list: "a, b", or "a and 3 more" for more than `most` of them.
std::string listing(const std::vector<std::string>& names, size_t most = 8);

}  // namespace jade
