// SPDX-License-Identifier: Apache-2.0
// The cameras of a scene whose exposure poses were learned. Renders do not change under a common
// motion and scaling of scene and cameras, so such a scene drifts away from the data's poses,
// including those of the test views.
#pragma once

#include <filesystem>

#include "jade/data/exposure.h"
#include "jade/splat/render.h"
#include "jade/train/exposure_poses.h"

namespace jade::run {

/// camera_from_world of an exposure's nine poses as used in training, [9,4,4] float32 on the CPU.
/// @param index  of the exposure among the training views
torch::Tensor learned_path(const train::ExposurePoses& poses, int64_t index,
                           const data::Exposure& exposure);

enum class OnInterrupt { kEnd, kFinish };

/// Options of the fit of the poses of test views and held-out exposures.
struct PoseFit {
  int64_t steps = 0;
  /// Fit the gain of each image at each step; else use the data's.
  bool gain = false;
  /// Whether an interrupt ends the fit early.
  OnInterrupt on_interrupt = OnInterrupt::kEnd;
  /// The result for an earlier scene of the run, from which the fit continues; null: the data set.
  const data::Dataset* from = nullptr;
};

/// The data set with the poses that match the scene. Exposures get their learned poses. Test views,
/// which training does not see, are moved by the similarity between the data's middle poses and the
/// learned ones, then fitted to their images with the scene fixed: Adam on a twist of the camera,
/// step size decreasing from 1e-3 to 1e-5, loss Eq. (8); returns the best pose found. Methods that
/// learn poses are scored this way (BAD-NeRF, BAD-Gaussians).
/// Held-out exposures are moved and fitted in the same way, with the nine poses of each as one
/// rigid body. Masked pixels do not count.
/// @param gaussians  on the device to render on, without graph
/// @param render     render_options() of the run
/// @throws NumericError for learned poses that are not finite
data::Dataset with_learned_poses(const data::Dataset& dataset, const train::ExposurePoses& poses,
                                 const splat::Gaussians& gaussians, const PoseFit& fit,
                                 const splat::RenderOptions& render);

/// Writes kCamerasFile of a run directory: the test views by name and the nine poses of each
/// exposure, in the format of data::read_cameras() and the coordinates of the data set.
void write_cameras(const std::filesystem::path& path, const data::Dataset& dataset);

/// Replaces the poses of the data set by those of such a file.
/// @throws DataError naming the file and the first view that does not match the data set.
void read_learned_cameras(const std::filesystem::path& path, data::Dataset& dataset);

}  // namespace jade::run
