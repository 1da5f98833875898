// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

namespace jade::events {

/// EFNet's symmetric cumulative event representation from six signed bins V1..V6:
///     −(V1+V2+V3), −(V2+V3), −V3, V4, V4+V5, V4+V5+V6,
/// the change from mid-exposure to t = 0, 1/6, 2/6, 4/6, 5/6, 1 of the exposure, divided by its
/// largest magnitude (zeros stay zeros). The division makes the scale of the bins irrelevant.
/// @param bins  [6,H,W] of any floating type, normalised or not.
torch::Tensor scer(const torch::Tensor& bins);

/// EFNet's event mask: 1 where any channel is not 0, after a 3x3 morphological closing.
/// @param events  [C,H,W]
/// @return [1,H,W] of the same type.
torch::Tensor event_mask(const torch::Tensor& events);

}  // namespace jade::events
