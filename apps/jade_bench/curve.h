// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

namespace jade::bench {

/// The scene's score after so many steps.
struct Milestone {
  int64_t step = 0;
  double seconds = 0;  ///< from the start, without the scoring
  double psnr = 0;     ///< dB, mean of the sharp test views
};

/// The first milestone at `goal` dB or above; null where there is none.
inline const Milestone* reached(const std::vector<Milestone>& curve, double goal) {
  for (const Milestone& at : curve) {
    if (at.psnr >= goal) return &at;
  }
  return nullptr;
}

}  // namespace jade::bench
