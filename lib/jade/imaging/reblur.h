// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

#include "jade/events/voxel.h"

namespace jade::imaging {

/// K of Eq. (7): (1/T) Σ_{k=1..T} exp(contrast · (E_k − E_m)),  E_k = Σ_{j≤k} V_j,  m = T/2.
/// The reblur operator is image ⊙ K, image and result in linear intensity. Constant for a view, so
/// callers keep it. 1 everywhere without events.
/// @param voxel     signed, max |V| = 1.
/// @param contrast  log intensity per unit of voxel; 1 in the paper.
/// @return [1,H,W] of the voxel's type
/// @throws ContractError if T is odd.
torch::Tensor reblur_kernel(const events::EventVoxel& voxel, double contrast);

}  // namespace jade::imaging
