// SPDX-License-Identifier: Apache-2.0
// One launch per step on a GPU: captures the alternation as a CUDA graph and replays it.
#pragma once

#include <memory>

#include "jade/train/step.h"

namespace jade::train {

/// While an instance exists, this thread queues its GPU work on a stream of its own, because the
/// default stream cannot be captured. Also limits the device's stack memory until the program ends
/// (core/device.h). Does nothing on the CPU.
class StreamScope {
 public:
  explicit StreamScope(torch::Device device);
  ~StreamScope();
  StreamScope(const StreamScope&) = delete;
  StreamScope& operator=(const StreamScope&) = delete;

 private:
  struct Guard;
  std::unique_ptr<Guard> guard_;
};

/// Runs alternate(), captured and replayed if the plan and the device allow it, else eagerly. The
/// results are those of alternate() except for the order of atomic sums. Each plan has its own
/// graph, so plans may alternate. Graphs stay valid while the tensors of the state are the same
/// objects and the inputs have the same shapes. A plan's first step runs eagerly, which warms up
/// the libraries; after a densification the next step is captured again at once. The next run
/// overwrites the outputs.
class StepGraph {
 public:
  StepGraph();
  ~StepGraph();
  StepGraph(const StepGraph&) = delete;
  StepGraph& operator=(const StepGraph&) = delete;

  StepOutputs run(TrainState& state, const StepInputs& inputs, const StepPlan& plan,
                  const RunOptions& options);

  /// Drops the graphs and the state's gradients and returns their memory to the device, for work
  /// between steps. The next step is captured again at once.
  void release(TrainState& state, torch::Device device);

  /// Number of steps that replayed a graph.
  int64_t replays() const { return replays_; }

 private:
  struct Recordings;
  std::unique_ptr<Recordings> recordings_;
  int64_t replays_ = 0;
};

}  // namespace jade::train
