// SPDX-License-Identifier: Apache-2.0
// The cameras of a scene whose exposure poses were learned. Frames look the same after any common
// motion and change of scale of scene and cameras, so such a scene wanders off from the data's
// poses, those of the test views among them.
#pragma once

#include <filesystem>

#include "jade/data/exposure.h"
#include "jade/splat/render.h"
#include "jade/train/exposure_poses.h"

namespace jade::run {

/// camera_from_world of an exposure's nine poses as training sees them, [9,4,4] float32 on the CPU.
/// @param index  of the exposure among the training views
torch::Tensor learned_path(const train::ExposurePoses& poses, int64_t index,
                           const data::Exposure& exposure);

enum class OnInterrupt { kEnd, kFinish };

/// The fit of the poses of test views and held-out exposures.
struct PoseFit {
  int64_t steps = 0;
  /// Images are as bright as suits the render best at each step; else as the data say.
  bool gain = false;
  /// Whether a request to stop ends the fit early.
  OnInterrupt on_interrupt = OnInterrupt::kEnd;
  /// The result for an earlier scene of the run, which the fit goes on from; null: the data set.
  const data::Dataset* from = nullptr;
};

/// The data set with the poses that the scene has for it. Exposures get their learned poses. Test
/// views, which training does not see, are moved by the similarity between the data's middle poses
/// and the learned ones, then fitted to their images with the scene held: Adam on a twist of the
/// camera, step size 1e-3 falling to 1e-5, loss Eq. (8); the best pose on the way is taken. Methods
/// that learn poses are scored this way (BAD-NeRF, BAD-Gaussians).
/// Held-out exposures are moved and fitted alike, the nine poses of each as one body. Pixels under
/// a mask do not count.
/// @param gaussians  on the device to render on, without graph
/// @param render     render_options() of the run
/// @throws NumericError for learned poses that are not finite
data::Dataset with_learned_poses(const data::Dataset& dataset, const train::ExposurePoses& poses,
                                 const splat::Gaussians& gaussians, const PoseFit& fit,
                                 const splat::RenderOptions& render);

/// Writes kLearnedCamerasFile of a run directory: the test views by name and the nine poses of each
/// exposure, in the form that data::read_cameras() reads,
/// in the coordinates of the data set.
void write_learned_cameras(const std::filesystem::path& path, const data::Dataset& dataset);

/// Puts the poses of such a file into the data set.
/// @throws DataError naming the file and the first view that is not the data set's.
void read_learned_cameras(const std::filesystem::path& path, data::Dataset& dataset);

}  // namespace jade::run
