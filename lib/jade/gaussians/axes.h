// SPDX-License-Identifier: Apache-2.0
// Changes of axes between our scenes and files. Not for use outside this folder.
#pragma once

#include "jade/splat/gaussians.h"

namespace jade::gaussians {

/// Gaussians after half a turn about x: from x right, y down, z forward to x right, y up, z back,
/// the axes of .spz and glTF, or the other way. Exact: it changes signs only.
splat::Gaussians half_turn(const splat::Gaussians& gaussians);

/// Gaussians after x → scale · R x + shift.
/// @param rotation  R, [3,3] float64, a rotation
/// @param shift     [3] float64
splat::Gaussians moved(const splat::Gaussians& gaussians, const torch::Tensor& rotation,
                       double scale, const torch::Tensor& shift);

}  // namespace jade::gaussians
