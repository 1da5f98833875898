// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

namespace jade::bench {

/// The scene's score after a number of steps.
struct Milestone {
  int64_t step = 0;
  double seconds = 0;  ///< since the start, without scoring
  double psnr = 0;     ///< dB, mean of the sharp test views
};

/// The first milestone at `goal` dB or above; null if there is none.
inline const Milestone* reached(const std::vector<Milestone>& curve, double goal) {
  for (const Milestone& at : curve) {
    if (at.psnr >= goal) return &at;
  }
  return nullptr;
}

}  // namespace jade::bench
