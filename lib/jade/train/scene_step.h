// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "jade/losses/scene.h"
#include "jade/train/state.h"
#include "jade/train/view.h"

namespace jade::train {

/// Renders the nine poses of a view, with graph and with densification statistics of step `step`.
Renders render_exposure(TrainState& state, const View& view, int64_t step,
                        const RunOptions& options);

/// One Adam step on φ (and the camera response), Eq. (8) to (10), with the target as re-evaluated
/// after the routing step, then densification when it is due. Touches neither θ nor its optimiser.
/// @param poses  [3] int64 on the device: the poses of L_edi gray, L_edi colour and L_sim.
/// @return the terms, as device scalars without graph
std::vector<losses::NamedTerm> scene_step(TrainState& state, const View& view,
                                          const Renders& renders, const torch::Tensor& target,
                                          const torch::Tensor& poses, int64_t step,
                                          const RunOptions& options);

}  // namespace jade::train
