// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "jade/losses/scene.h"
#include "jade/train/event_windows.h"
#include "jade/train/state.h"
#include "jade/train/view.h"

namespace jade::train {

/// Renders the nine poses of a view, with graph and with densification statistics of step `step`.
Renders render_exposure(TrainState& state, const View& view, int64_t view_index, int64_t step,
                        const RunOptions& options);

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
