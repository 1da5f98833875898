// SPDX-License-Identifier: Apache-2.0
// Rigid motions as differentiable tensors, for learned poses. geometry/pose.h has constant poses.
#pragma once

#include <torch/types.h>

namespace jade::geometry {

/// exp: se(3) → SE(3). A twist is (ρ, ω): ω the rotation vector in radians and ρ the translation
/// along it, so that exp([ρ, 0]) translates by ρ.
///     R = I + A[ω] + B[ω]²,  t = (I + B[ω] + C[ω]²) ρ,
///     A = sin θ / θ,  B = (1 − cos θ) / θ²,  C = (θ − sin θ) / θ³,  θ = |ω|.
/// @param twist  [...,6] of any floating type; float64 keeps small motions accurate.
/// @return [...,4,4]; differentiable any number of times, including at zero
torch::Tensor se3_exp(const torch::Tensor& twist);

/// [6] float64, (unit, unit, unit, 1, 1, 1): turns a twist whose translation counts units into one
/// in the lengths of the scene.
torch::Tensor twist_unit(double unit);

/// The inverse of rigid motions [...,4,4]; differentiable.
torch::Tensor se3_inverse(const torch::Tensor& motion);

}  // namespace jade::geometry
