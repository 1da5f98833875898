// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <torch/types.h>
#include <vector>

#include "jade/gaussians/densify.h"
#include "jade/gaussians/gaussian_model.h"
#include "jade/gaussians/optimizer.h"
#include "jade/geometry/trajectory.h"
#include "jade/response/camera_response.h"
#include "jade/router/allocation.h"
#include "jade/train/exposure_poses.h"
#include "jade/train/module_adam.h"
#include "jade/train/options.h"

namespace jade::train {

/// All that changes during training, and so all that a checkpoint holds. The view order and the
/// pose draws are functions of the seed and the step, so they need no state.
struct TrainState {
  int64_t step = 0;                    ///< finished steps
  gaussians::GaussianModel gaussians;  ///< φ
  gaussians::GaussianAdam gaussian_adam;
  gaussians::Densifier densifier;
  std::shared_ptr<router::Allocation> allocation;  ///< θ; nullptr without a routed target
  ModuleAdam allocation_adam;                      ///< empty where nothing is learned
  response::CameraResponse response{nullptr};      ///< nullptr when off
  ModuleAdam response_adam;
  std::shared_ptr<ExposurePoses> poses;  ///< nullptr where the data's poses stay
  ModuleAdam poses_adam;
};

/// The renders of one exposure, made once a step and used by both steps.
struct Renders {
  torch::Tensor color;  ///< [M,3,H,W] with its graph: nine, or those of losses::poses_read()
  bool all_poses() const { return color.size(0) == geometry::kExposurePoses; }
  /// Mid-exposure, where the target acts.
  torch::Tensor mid() const { return color[all_poses() ? geometry::kMidPose : 0]; }
};

}  // namespace jade::train
