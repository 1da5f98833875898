// SPDX-License-Identifier: Apache-2.0
// Builds without CUDA kernels: steps run eagerly.
#include "jade/train/step_graph.h"

namespace jade::train {

struct StreamScope::Guard {};
StreamScope::StreamScope(torch::Device) {}
StreamScope::~StreamScope() = default;

struct StepGraph::Recordings {};
StepGraph::StepGraph() = default;
StepGraph::~StepGraph() = default;

void StepGraph::release(TrainState&, torch::Device) {}

StepOutputs StepGraph::run(TrainState& state, const StepInputs& inputs, const StepPlan& plan,
                           const RunOptions& options) {
  return alternate(state, inputs, plan, options);
}

}  // namespace jade::train
