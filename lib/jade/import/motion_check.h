// SPDX-License-Identifier: Apache-2.0
// Whether what structure from motion says agrees with what it has not looked at.
#pragma once

#include <array>
#include <cstdint>
#include <torch/types.h>
#include <vector>

#include "jade/geometry/camera.h"
#include "jade/geometry/pose.h"

namespace jade::import {

/// Motion of the camera as frames alone show it.
struct FrameMotion {
  double shift_px = 0;   ///< the longest measured shift between two frames
  int64_t compared = 0;  ///< pairs of frames
  int64_t measured = 0;  ///< pairs with a correlation peak that noise does not make
};

/// Measures how far the picture moves from each frame to the next, and from the first to all.
/// Patterns fixed to the sensor (pixel and row noise, dust, vignetting) are removed first: the mean
/// of all frames, scaled to each, and details smaller than a pixel or larger than a sixteenth of
/// the width. Frames of a still camera are then noise without a common shift: measured is 0.
/// @param images  [3,H,W] of one size, at least two, in order of time
FrameMotion frame_motion(const std::vector<torch::Tensor>& images);

/// One exposure with the poses that were found for it.
struct PosedExposure {
  torch::Tensor blurry, sharp;            ///< [3,H,W]: the frame, and its restoration at the middle
  geometry::Intrinsics camera;            ///< of both
  std::vector<geometry::Pose> poses;      ///< along the exposure, at equal steps
  std::vector<geometry::Vector3> points;  ///< that it sees
};

/// Which share of the blur around the points the poses explain, over all exposures:
///     1 − Σ |B − mean_k S(x − d_k)|² / min(Σ |B − S|², Σ |B − mean_k S(x − d_k⊥)|²)
/// with d_k the way of a point in the image from the middle pose to pose k and d⊥ the same turned
/// by 90°, on patches of 13x13 pixels. Near 1 where the camera moved as the poses say, about 0
/// where they stand still or know nothing of the direction, below 0 where they are wrong. Any blur
/// is nearer to a blurry frame than a sharp image is; hence the second rival. The frame itself
/// takes no part in finding poses.
/// @return 0 where no point is in view
double explained_blur(const std::vector<PosedExposure>& exposures);

}  // namespace jade::import
