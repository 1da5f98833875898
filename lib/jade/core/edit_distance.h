// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace jade {

/// Edit distance of Damerau and Levenshtein, in which an exchange of two neighbours counts once.
size_t edit_distance(const std::string& a, const std::string& b);

/// For files that may have further names: the first of `words` that `word` is with a letter too
/// many, too few or wrong, or two exchanged, one more slip for each ten letters. Empty if there is
/// none, or if `word` is one of them.
std::string misspelt(const std::string& word, const std::vector<std::string>& words);

}  // namespace jade
