// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "jade/train/scene_step.h"

namespace jade::train {

struct StepOutputs {
  Renders renders;
  /// Every term by name, as detached device scalars; the router's are "route_render" and
  /// "route_reblur".
  std::vector<losses::NamedTerm> terms;
};

/// One alternation (paper, Algorithm): renders once, updates θ against the detached renders,
/// recomputes α without gradient, then updates φ. Neither densifies nor counts the step;
/// update_exposures() must be called next.
/// @param plan  plan_step() of the inputs' step
StepOutputs alternate(TrainState& state, const StepInputs& inputs, const StepPlan& plan,
                      const RunOptions& options);

/// Updates after alternate(), outside a captured step: an Adam step of the exposure's learned poses
/// and gain, and removal of the freedom that all exposures share. Does nothing if neither is
/// learned.
/// @param step  that of the inputs
void update_exposures(TrainState& state, const RunOptions& options, int64_t step);

}  // namespace jade::train
