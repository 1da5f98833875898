// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <torch/types.h>
#include <vector>

#include "jade/geometry/trajectory.h"
#include "jade/models/allocation.h"
#include "jade/models/crf.h"
#include "jade/scene/densify.h"
#include "jade/scene/gaussian_model.h"
#include "jade/scene/optimizer.h"
#include "jade/train/exposure_poses.h"
#include "jade/train/module_adam.h"
#include "jade/train/options.h"

namespace jade::train {

/// All that changes during training, and so all that a checkpoint holds. The view order and the
/// pose draws are functions of the seed and the step, so they need no state.
struct TrainState {
  int64_t step = 0;                ///< finished steps
  scene::GaussianModel gaussians;  ///< φ
  scene::GaussianAdam gaussian_adam;
  scene::Densifier densifier;
  std::shared_ptr<models::Allocation> allocation;  ///< θ; nullptr without a routed target
  ModuleAdam allocation_adam;                      ///< empty where nothing is learned
  models::Crf crf{nullptr};                        ///< nullptr when off
  ModuleAdam crf_adam;
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
