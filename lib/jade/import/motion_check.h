// SPDX-License-Identifier: Apache-2.0
// Checks the result of structure from motion against data that it did not use.
#pragma once

#include <array>
#include <cstdint>
#include <torch/types.h>
#include <vector>

#include "jade/geometry/camera.h"
#include "jade/geometry/pose.h"

namespace jade::import {

/// Motion of the camera, measured in the frames alone.
struct FrameMotion {
  double shift_px = 0;   ///< the longest measured shift between two frames
  int64_t compared = 0;  ///< pairs of frames
  int64_t measured = 0;  ///< pairs with a correlation peak above the noise
};

/// Measures how far the image moves between consecutive frames, and between the first and all
/// others. First removes patterns fixed to the sensor (pixel and row noise, dust, vignetting): the
/// mean of all frames, scaled to each, and details smaller than a pixel or larger than a sixteenth
/// of the width. Frames of a static camera are then noise without a common shift: measured is 0.
/// @param images  [3,H,W] of one size, at least two, in order of time
FrameMotion frame_motion(const std::vector<torch::Tensor>& images);

/// One exposure with its estimated poses.
struct PosedExposure {
  torch::Tensor blurry, sharp;            ///< [3,H,W]: the frame, and its restoration at the middle
  geometry::Intrinsics camera;            ///< of both
  std::vector<geometry::Pose> poses;      ///< along the exposure, at equal time steps
  std::vector<geometry::Vector3> points;  ///< points visible in it
};

/// Share of the blur around the points that the poses explain, over all exposures:
///     1 − Σ |B − mean_k S(x − d_k)|² / min(Σ |B − S|², Σ |B − mean_k S(x − d_k⊥)|²)
/// with d_k the image motion of a point from the middle pose to pose k and d⊥ the same rotated by
/// 90°, on patches of 13x13 pixels. Near 1 if the camera moved as the poses say, about 0 if they
/// are static or independent of the direction, negative if they are wrong. The rotated motion is
/// the second alternative because any blur is nearer to a blurry frame than a sharp image is. The
/// poses were estimated without the frame itself.
/// @return 0 if no point is in view
double explained_blur(const std::vector<PosedExposure>& exposures);

/// Length of the blur according to the poses, px: the median over all points and exposures of twice
/// the largest distance of a point from its place at the middle.
/// @return 0 if no point is in view
double posed_blur_px(const std::vector<PosedExposure>& exposures);

}  // namespace jade::import
