// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "jade/losses/objective.h"
#include "jade/train/event_windows.h"
#include "jade/train/state.h"
#include "jade/train/view.h"

namespace jade::train {

/// The nine cameras of a view: the data's, or the learned ones, differentiable in the state's
/// poses.
splat::CameraBatch exposure_cameras(const TrainState& state, const View& view, int64_t view_index);

/// Renders the poses of a view that the terms of `step` read, with graph and with that step's
/// densification statistics.
/// @param draws  SceneStepInputs.poses
Renders render_exposure(TrainState& state, const View& view, int64_t view_index,
                        const torch::Tensor& draws, int64_t step, const RunOptions& options);

/// What the scene step takes besides the state.
struct SceneStepInputs {
  const View& view;
  const Renders& renders;
  torch::Tensor target;  ///< [3,H,W], as re-evaluated after the routing step; undefined: no L_tgt
  torch::Tensor poses;   ///< [3] int64 on the device: those of L_edi gray, L_edi colour and L_sim
  EventWindow events;    ///< of L_ev; undefined: no L_ev
};

/// One Adam step on φ (with the camera response and learned poses), Eq. (8) to (10). Touches
/// neither θ nor its optimiser. Does not densify.
/// @return the terms, as device scalars without graph
std::vector<losses::NamedTerm> scene_step(TrainState& state, const SceneStepInputs& inputs,
                                          int64_t step, const RunOptions& options);

}  // namespace jade::train
