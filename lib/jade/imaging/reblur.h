// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

#include "jade/events/voxel.h"

namespace jade::imaging {

/// K of Eq. (7): (1/T) Σ_{k=1..T} exp(contrast · (E_k − E_m)),  E_k = Σ_{j≤k} V_j,  m = T/2. For a
/// moment u other than mid-exposure, an extension of this library, E_m is E at u, linear within its
/// bin: the same blur relative to the sharp image of that moment.
/// The reblur operator is image ⊙ K, image and result in linear intensity. Constant for a view, so
/// callers store it. 1 everywhere without events.
/// @param voxel     signed, max |V| = 1.
/// @param contrast  log intensity per unit of voxel; 1 in the paper.
/// @param moment    u in [0,1], 0 the start and 1 the end of the exposure.
/// @return [1,H,W] of the voxel's type
/// @throws ContractError if T is odd.
torch::Tensor reblur_kernel(const events::EventVoxel& voxel, double contrast, double moment = 0.5);

}  // namespace jade::imaging
