// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "jade/train/scene_step.h"

namespace jade::train {

struct StepOutputs {
  Renders renders;
  /// Every term by name, as device scalars without graph; the router's are "route_render" and
  /// "route_reblur".
  std::vector<losses::NamedTerm> terms;
};

/// One alternation (paper, Algorithm): all renders once, the routing step on θ against them
/// without gradient, α again without gradient, then the scene step on φ. Neither densifies nor
/// counts the step; update_exposures() follows.
/// @param plan  plan_step() of the inputs' step
StepOutputs alternate(TrainState& state, const StepInputs& inputs, const StepPlan& plan,
                      const RunOptions& options);

/// What is due after alternate(), and outside of a recorded step: the gradients of learned poses
/// and gains end in an Adam step of their exposure, and what all exposures share is held. Does
/// nothing where neither is learned.
/// @param step  that of the inputs
void update_exposures(TrainState& state, const RunOptions& options, int64_t step);

}  // namespace jade::train
