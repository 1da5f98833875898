// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <torch/types.h>

#include "jade/restore/restorations.h"

namespace jade::run {

/// How well an allocation chose between two restorations, as a sharp truth tells.
struct AllocationChoice {
  /// Share of the pixels where α > ½ and EDI is nearer to the truth, or α ≤ ½ and the learned
  /// restoration is; nearer by the mean over the channels of the absolute difference, and pixels
  /// where both are equally near are left out. Absent where they all are.
  std::optional<double> right;
  /// PSNR of the mix less that of the better of the two, dB: below 0, one of them alone is better.
  double gain_db = 0;
};

/// @param alpha  anything that broadcasts to [1,H,W]
/// @param truth  [3,H,W] of any device
AllocationChoice allocation_choice(const torch::Tensor& alpha,
                                   const restore::Restorations& restorations,
                                   const torch::Tensor& truth);

}  // namespace jade::run
