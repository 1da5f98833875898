// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "jade/splat/tensor.h"

namespace jade::splat {

/// N Gaussians by their raw (pre-activation) parameters, all of one dtype and on one device.
struct Gaussians {
  Tensor means;            ///< [N,3] world
  Tensor rotations;        ///< [N,4] wxyz, not normalised
  Tensor log_scales;       ///< [N,3]
  Tensor logit_opacities;  ///< [N]
  Tensor sh;               ///< [N,K,3], K = 1, 4, 9 or 16; [:,0] is the DC coefficient

  int64_t size() const { return means.size(0); }
};

/// Throws ContractError unless shapes, dtypes (float or double) and devices are as stated above.
void check(const Gaussians& gaussians);

}  // namespace jade::splat
