// SPDX-License-Identifier: Apache-2.0
#include "jade/core/edit_distance.h"

#include <algorithm>
#include <numeric>

namespace jade {

size_t edit_distance(const std::string& a, const std::string& b) {
  std::vector<size_t> before, row(b.size() + 1), next(b.size() + 1);
  std::iota(row.begin(), row.end(), size_t{0});
  for (size_t i = 1; i <= a.size(); ++i) {
    next[0] = i;
    for (size_t j = 1; j <= b.size(); ++j) {
      const size_t change = row[j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1);
      next[j] = std::min({change, row[j] + 1, next[j - 1] + 1});
      const bool exchanged = i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1];
      if (exchanged) next[j] = std::min(next[j], before[j - 2] + 1);
    }
    before = row, row = next;
  }
  return row.back();
}

std::string misspelt(const std::string& word, const std::vector<std::string>& words) {
  constexpr size_t kShortest = 4, kLettersPerSlip = 10;
  if (word.size() < kShortest || std::find(words.begin(), words.end(), word) != words.end())
    return "";
  const auto found = std::find_if(words.begin(), words.end(), [&](const std::string& candidate) {
    return candidate.size() >= kShortest &&
           edit_distance(word, candidate) <= 1 + candidate.size() / kLettersPerSlip;
  });
  return found == words.end() ? "" : *found;
}

}  // namespace jade
