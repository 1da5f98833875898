// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "jade/train/scene_step.h"

namespace jade::train {

/// What one step is given besides the state.
struct StepInputs {
  const View& view;
  int64_t view_index = 0;  ///< among the training views
  torch::Tensor poses;     ///< [3] int64 on the device, see SceneStepInputs
  EventWindow events;      ///< of L_ev; undefined: no L_ev
};

struct StepOutputs {
  Renders renders;
  /// Every term by name, as device scalars without graph; the router's are "route_render" and
  /// "route_reblur".
  std::vector<losses::NamedTerm> terms;
};

/// One alternation (paper, Algorithm): nine renders once, the routing step on θ against them
/// without gradient, α again without gradient, then the scene step on φ. Neither densifies nor
/// counts the step.
StepOutputs alternate(TrainState& state, const StepInputs& inputs, int64_t step,
                      const RunOptions& options);

}  // namespace jade::train
