// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>

#include "jade/losses/objective.h"
#include "jade/train/plan.h"
#include "jade/train/state.h"
#include "jade/train/step_inputs.h"

namespace jade::train {

/// Runs its argument, on a GPU on a second stream: the target may still be computed there, while
/// the other terms run on the first.
using Beside = std::function<void(const std::function<void()>&)>;

/// The cameras of the inputs' view: the data's, or the learned ones at their times, differentiable
/// in the state's poses.
/// @param read  [M] int64, which of them; undefined: all
splat::CameraBatch exposure_cameras(const TrainState& state, const StepInputs& inputs,
                                    const torch::Tensor& read = {});

/// Matches renders of an exposure to its frame: multiplies by the exposure's gain, if it has one,
/// and sets masked pixels to black, as in frames and targets.
/// @param color  [...,3,H,W]
torch::Tensor as_in_frame(const TrainState& state, const StepInputs& inputs,
                          const torch::Tensor& color);

/// Renders the poses of a view that the terms of the plan read, with their graph and, if the plan
/// keeps them, with the statistics of densification, which exclude the window of L_ev.
Renders render_exposure(TrainState& state, const StepInputs& inputs, const StepPlan& plan,
                        const RunOptions& options);

/// One Adam step on φ (with the camera response), Eq. (8) to (10), with the
/// term "poses" if learned poses have a prior; their gradients are accumulated for
/// update_exposures(). Changes neither θ nor its optimiser. Does not densify.
/// @param target  [3,H,W], recomputed after the routing step; needed for L_tgt only
/// @param beside  runs L_tgt, regularisation and small updates; empty: they run in order
/// @param response_table  of the state's response; undefined: computed on first use
/// @return the terms, as detached device scalars
std::vector<losses::NamedTerm> scene_step(TrainState& state, const StepInputs& inputs,
                                          const Renders& renders, const torch::Tensor& target,
                                          const StepPlan& plan, const RunOptions& options,
                                          const Beside& beside = {},
                                          const torch::Tensor& response_table = {});

}  // namespace jade::train
