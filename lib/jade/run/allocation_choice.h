// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <torch/types.h>

#include "jade/restore/restorations.h"

namespace jade::run {

/// How well an allocation chose between two restorations, judged by a true sharp image.
struct AllocationChoice {
  /// Share of the pixels where α > ½ and EDI is nearer to the truth, or α ≤ ½ and the learned
  /// restoration is; nearer by the mean absolute difference over the channels, ignoring pixels
  /// where both are equally near. No value if all are.
  std::optional<double> right;
  /// PSNR of the mix minus that of the better restoration, dB: negative if one of them alone is
  /// better.
  double gain_db = 0;
};

/// @param alpha  broadcasts to [1,H,W]
/// @param truth  [3,H,W] on any device
AllocationChoice allocation_choice(const torch::Tensor& alpha,
                                   const restore::Restorations& restorations,
                                   const torch::Tensor& truth);

}  // namespace jade::run
