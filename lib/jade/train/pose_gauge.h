// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

namespace jade::train {

/// Gauge freedom of learned poses: a motion and a change of scale that the scene and all cameras
/// share. To first order in the twists these are seven directions of all twists together,
/// of a shift v, a turn w and a growth s of the world about the cameras' centroid:
///     ω = Rᵀw,  ρ = Rᵀ(v + w×c + s c),
/// for a camera with rotation R (world from camera) that stands at c. In camera axes they differ
/// from camera to camera, so the plain mean of the twists is not one of them.
struct PoseGauge {
  torch::Tensor read;  ///< [G,V,K,6] float64; Σ read · twists is how far they went each way
  torch::Tensor
      write;  ///< [G,V,K,6] float64; the ways themselves. G is 7, or less where ways agree
};

/// @param control  [V,K,4,4] float64, world_from_camera where the twists act
/// @param depth    of the scene: a translation by it counts as a turn by one radian
PoseGauge pose_gauge(const torch::Tensor& control, double depth);

/// Takes the part of the twists [V,K,6], float64 and contiguous, that lies along the gauge out of
/// them, in place. On a GPU on the current stream; the current device must be theirs.
void remove_gauge(const PoseGauge& gauge, const torch::Tensor& twists);

}  // namespace jade::train
