// SPDX-License-Identifier: Apache-2.0
// One launch per step on a GPU: the alternation recorded as a CUDA graph and replayed.
#pragma once

#include <memory>

#include "jade/train/step.h"

namespace jade::train {

/// While it lives, this thread's work on a GPU is queued on a stream of its own: the default stream
/// cannot be recorded. Bounds the device's stack memory too, for good (core/device.h). Does nothing
/// for the CPU.
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

/// alternate(), recorded and replayed where the plan and the device allow it, else run eagerly. The
/// results are those of alternate() but for the order of atomic sums. Each plan has a recording of
/// its own, so that plans may alternate. All hold while the tensors of the state stay the same
/// objects and those of the inputs of the same shapes. A plan's first step runs eagerly, which
/// warms up what it calls; after a densification its next step is recorded anew at once. Outputs
/// are overwritten by the next run.
class StepGraph {
 public:
  StepGraph();
  ~StepGraph();
  StepGraph(const StepGraph&) = delete;
  StepGraph& operator=(const StepGraph&) = delete;

  StepOutputs run(TrainState& state, const StepInputs& inputs, const StepPlan& plan,
                  const RunOptions& options);

  /// How many steps were replays of a recording.
  int64_t replays() const { return replays_; }

 private:
  struct Recordings;
  std::unique_ptr<Recordings> recordings_;
  int64_t replays_ = 0;
};

}  // namespace jade::train
