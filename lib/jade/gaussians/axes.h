// SPDX-License-Identifier: Apache-2.0
// Changes of axes between this library's scenes and files. Private to this folder.
#pragma once

#include "jade/splat/gaussians.h"

namespace jade::gaussians {

/// Rotates Gaussians by half a turn about x: from x right, y down, z forward to x right, y up, z
/// back, the axes of .spz and glTF, and vice versa. Exact: only signs change.
splat::Gaussians half_turn(const splat::Gaussians& gaussians);

/// Transforms Gaussians by x → scale · R x + shift.
/// @param rotation  R, [3,3] float64, a rotation
/// @param shift     [3] float64
splat::Gaussians moved(const splat::Gaussians& gaussians, const torch::Tensor& rotation,
                       double scale, const torch::Tensor& shift);

}  // namespace jade::gaussians
