// SPDX-License-Identifier: Apache-2.0
// A camera's path through one exposure, corrected by learned twists. exposure_path_math.h has the
// arithmetic.
#pragma once

#include <torch/types.h>

namespace jade::geometry {

/// Multiplies a given path by a correction that varies along the exposure,
///     world_from_camera(u) = data(u) · exp(ξ(u)),  ξ(u) = Σ_j b_j(u) ξ_j,
/// with b_j the linear basis for two twists, or the uniform cubic B-spline's for four or more: its
/// K − 3 middle segments cover the exposure. Zero twists return the given path bit for bit.
/// @param twists             [K,6] float64, ξ_j = (ρ, ω) as in se3_exp(); K 2, 4 or more
/// @param u [M] float64, times in units of the exposure, 0 its start and 1 its end
/// @param camera_from_world [M,4,4] float32 or float64, the data's at these times
/// @return camera_from_world [M,4,4] float64; differentiable in the twists only, and once
torch::Tensor corrected_path(const torch::Tensor& twists, const torch::Tensor& u,
                             const torch::Tensor& camera_from_world);

/// The path of the control poses C_j · exp(ξ_j): for two of them the line in SE(3), for four the
/// uniform cumulative cubic B-spline
///     world_from_camera(u) = P_0 Π_j exp(w_j(u) log(P_{j−1}⁻¹ P_j)).
/// @param twists   [K,6] float64, K 2 or 4
/// @param u        [M] float64
/// @param control  [K,4,4] float64, C_j as world_from_camera, less than 90° from one to the next
/// @return camera_from_world [M,4,4] float64; differentiable in the twists only, and once
torch::Tensor spline_path(const torch::Tensor& twists, const torch::Tensor& u,
                          const torch::Tensor& control);

/// Arguments of both paths without autograd: all tensors contiguous, float64 and on one device.
struct ExposurePath {
  at::Tensor twists;      ///< [K,6]
  at::Tensor u;           ///< [M]
  at::Tensor base;        ///< the data's poses [M,4,4], or control poses [K,4,4]
  bool corrects = false;  ///< base contains the data's poses
};

namespace cpu {
at::Tensor exposure_path(const ExposurePath& path);
/// The twists' gradient [K,6] from that of the poses, [M,4,4].
at::Tensor exposure_path_backward(const ExposurePath& path, const at::Tensor& gradient);
}  // namespace cpu

namespace cuda {
at::Tensor exposure_path(const ExposurePath& path);
/// Sums in a fixed order, so that the result is deterministic.
at::Tensor exposure_path_backward(const ExposurePath& path, const at::Tensor& gradient);
}  // namespace cuda

}  // namespace jade::geometry
