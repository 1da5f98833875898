// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace jade {

/// In lower case; letters beyond ASCII stay.
std::string in_small_letters(std::string text);

bool has_ending(std::string_view text, std::string_view ending);

/// The index of one of `count` names, zero-padded to the digits of the last one, so that names sort
/// as numbers do.
std::string padded(size_t index, size_t count);

/// The names as a list: "a, b", or "a and 3 more" for more than `most` of them.
std::string listing(const std::vector<std::string>& names, size_t most = 8);

}  // namespace jade
