// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "jade/config/config.h"
#include "jade/core/edit_distance.h"

namespace jade::config {

std::string nearest(const std::string& word, const std::vector<std::string>& words) {
  std::string best;
  size_t best_distance = std::max<size_t>(2, word.size() / 3) + 1;
  for (const std::string& candidate : words) {
    const size_t distance = edit_distance(word, candidate);
    if (distance < best_distance) {
      best_distance = distance;
      best = candidate;
    }
  }
  return best;
}

}  // namespace jade::config
