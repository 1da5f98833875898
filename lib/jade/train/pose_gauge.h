// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

namespace jade::train {

/// Gauge freedom of learned poses: a motion and a change of scale that the scene and all cameras
/// share. To first order in the twists these are seven directions in the space of all twists, from
/// a translation v, a rotation w and a scaling s of the world about the cameras' centroid:
///     ω = Rᵀw,  ρ = Rᵀ(v + w×c + s c),
/// for a camera with rotation R (world from camera) and centre c. In camera axes they differ from
/// camera to camera, so the plain mean of the twists is not one of them.
struct PoseGauge {
  torch::Tensor read;  ///< [G,V,K,6] float64; Σ read · twists is the component along each direction
  torch::Tensor write;  ///< [G,V,K,6] float64; the directions. G is 7, or less if some coincide
};

/// @param control  [V,K,4,4] float64, world_from_camera at the twists
/// @param depth    of the scene: a translation by it counts as much as a rotation by one radian
PoseGauge pose_gauge(const torch::Tensor& control, double depth);

/// Removes, in place, the component along the gauge from the twists [V,K,6], float64 and
/// contiguous. On a GPU it runs on the current stream; their device must be the current one.
void remove_gauge(const PoseGauge& gauge, const torch::Tensor& twists);

}  // namespace jade::train
