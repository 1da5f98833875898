// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/gaussians/densify.h"
#include "jade/gaussians/gaussian_model.h"
#include "jade/gaussians/init.h"
#include "jade/gaussians/optimizer.h"
#include "jade/response/camera_response.h"
#include "jade/router/allocation.h"
#include "jade/train/exposure_gains.h"
#include "jade/train/exposure_poses.h"
#include "jade/train/fixed_pattern.h"
#include "jade/train/learned.h"
#include "jade/train/module_adam.h"
#include "jade/train/options.h"
#include "jade/train/row_adam.h"

namespace jade::train {

/// Everything that changes during training, and therefore the content of a checkpoint. The view
/// order and the sampled poses are functions of the seed and the step, so they need no state.
struct TrainState {
  int64_t step = 0;                    ///< finished steps
  gaussians::GaussianModel gaussians;  ///< φ
  gaussians::GaussianAdam gaussian_adam;
  gaussians::Densifier densifier;
  Learned<router::Allocation, ModuleAdam> allocation;  ///< θ; only of a routed target
  Learned<response::CameraResponseImpl, ModuleAdam> response;
  Learned<ExposurePoses, RowAdam> poses;      ///< only if learned; one row per exposure
  Learned<ExposureGains, RowAdam> gains;      ///< only if some frame has one; one row per exposure
  Learned<FixedPattern, ModuleAdam> pattern;  ///< only if learned

  /// Calls `visitor(name, tensor)` for every tensor, once.
  void visit(const std::function<void(const std::string&, const torch::Tensor&)>& visitor) const;
  /// Drops the gradients of all parameters.
  void zero_grad();
};

/// Factor of densify.gradient_threshold, which assumes nine renders: each of K renders has a K-th
/// of L_blur, L_sim and L_int, so their mean screen gradient is inversely proportional to K.
double gradient_factor(const RunOptions& options, int64_t moment_stride);

/// Initial values of a new state.
struct Start {
  splat::Gaussians gaussians;
  double extent = 1;        ///< of the scene, see gaussians::scene_extent
  double unit = 1;          ///< see data::length_unit
  bool monochrome = false;  ///< the Gaussians are gray and must stay so
  int64_t views = 1;        ///< training views, and their size
  int64_t height = 0, width = 0;
};

/// The state before the first step, with all of its modules on `device`; without learned poses and
/// gains, which need exposures.
TrainState make_state(const RunOptions& options, const Start& start, torch::Device device);

/// Adds learned poses of the data set's exposures, if the options request them.
void learn_poses(TrainState& state, const PoseOptions& options, const data::Dataset& dataset,
                 torch::Device device);

/// Adds gains of the data set's exposures, if it has any or the options request that they be
/// learned.
void take_gains(TrainState& state, const GainOptions& options, const data::Dataset& dataset,
                torch::Device device);

/// Adds the pattern that the data set's frames share, if the options request it.
void learn_pattern(TrainState& state, const PatternOptions& options, const data::Dataset& dataset,
                   torch::Device device);

/// Sources of a scene's start: the middles of the exposures, without stray ones, depth bounds and
/// points.
gaussians::InitSources init_sources(const data::Dataset& dataset);

/// Creates the state for a data set, with learned poses and gains if the options request them.
/// @throws ConfigError, DataError as gaussians::initial_gaussians.
TrainState make_state(const RunOptions& options, const data::Dataset& dataset,
                      torch::Device device);

/// A state of the same structure into which a checkpoint can be loaded: reads no initial scene and
/// contains a single Gaussian.
TrainState make_state_to_load(const RunOptions& options, const data::Dataset& dataset,
                              torch::Device device);

/// The renders of one exposure, computed once per step and used by both steps.
struct Renders {
  /// [M,3,H,W] with graph: all K, or those of losses::poses_read(); as_in_frame() was applied
  torch::Tensor color;
  bool all_poses = true;
  torch::Tensor target_pose = {};  ///< [1] int64 if it is sampled, else undefined
  torch::Tensor window_ends = {};  ///< [2,3,H,W] at both ends of the window of L_ev, with graph
  /// Render at the target's pose: mid-exposure, or the sampled pose.
  torch::Tensor of_target() const {
    if (!all_poses) return color[0];
    return target_pose.defined() ? color.index_select(0, target_pose)[0] : color[color.size(0) / 2];
  }
};

}  // namespace jade::train
