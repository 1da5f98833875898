// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

#include "jade/events/voxel.h"

namespace jade::imaging {

/// K of Eq. (7): (1/T) Σ_{k=1..T} exp(contrast · (E_k − E_m)),  E_k = Σ_{j≤k} V_j,  m = T/2.
/// Constant for a view, so callers keep it. 1 everywhere without events.
/// @return [1,H,W] of the voxel's type
/// @throws ContractError if T is odd.
torch::Tensor reblur_kernel(const events::EventVoxel& voxel, double contrast);

/// Blurs a sharp mid-exposure image with the event exposure model, Eq. (7).
///     out = image ⊙ (1/T) Σ_k exp(contrast · (E_k − E_m)),   E_k = Σ_{j≤k} V_j,  m = T/2
/// @param image     [3,H,W], linear intensity at mid-exposure. Differentiable.
/// @param voxel     [T,H,W], signed, max |V| = 1 (see voxelize). Constant.
/// @param contrast  log-intensity per unit of voxel; 1 in the paper.
/// @throws ContractError if T is odd or the spatial sizes differ.
torch::Tensor reblur(const torch::Tensor& image, const events::EventVoxel& voxel, double contrast);

/// The mid-exposure image whose reblur is `blurry`: blurry / K. With contrast = Θ · v_max it is the
/// EDI of T samples. reblur(unblur(B, V, c), V, c) = B for every voxel.
torch::Tensor unblur(const torch::Tensor& blurry, const events::EventVoxel& voxel, double contrast);

}  // namespace jade::imaging
