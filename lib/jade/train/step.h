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

/// Updates after alternate(), outside of a recorded step: an Adam step of the exposure's learned
/// poses and gain; the freedom that all exposures share is removed. Does nothing if neither is
/// learned.
/// @param step  that of the inputs
void update_exposures(TrainState& state, const RunOptions& options, int64_t step);

}  // namespace jade::train
