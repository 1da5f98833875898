// SPDX-License-Identifier: Apache-2.0
#include "jade/train/view.h"

#include <algorithm>
#include <torch/types.h>

namespace jade::train {

double near_plane(const SplatOptions& options, const data::Dataset& dataset) {
  return options.near_plane > 0 ? options.near_plane : std::min(0.2, 0.5 * dataset.near);
}

splat::RenderOptions render_options(const RunOptions& options) {
  splat::RenderOptions render;
  if (options.splat.near_plane > 0) render.near_plane = options.splat.near_plane;
  render.deterministic = options.deterministic;
  return render;
}

torch::Tensor pose_times(torch::Device device) {
  return torch::linspace(0, 1, geometry::kExposurePoses, torch::kFloat64).to(device);
}

splat::CameraBatch camera_batch(const std::vector<geometry::Pose>& camera_from_world,
                                const geometry::Intrinsics& camera, torch::Device device) {
  const auto count = static_cast<int64_t>(camera_from_world.size());
  const auto options = torch::TensorOptions(device).dtype(torch::kFloat32);
  splat::CameraBatch batch;
  batch.camera_from_world = geometry::to_tensor(camera_from_world).to(options);
  batch.intrinsics = geometry::to_tensor(camera).to(options).expand({count, 4}).contiguous();
  batch.width = camera.width;
  batch.height = camera.height;
  return batch;
}

}  // namespace jade::train
