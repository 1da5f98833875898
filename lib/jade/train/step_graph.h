// SPDX-License-Identifier: Apache-2.0
// One launch a step on a GPU: the alternation recorded as a CUDA graph and replayed.
#pragma once

#include <memory>

#include "jade/train/step.h"

namespace jade::train {

/// While it lives, this thread's work on a GPU is queued on a stream of its own: the default stream
/// cannot be recorded. Does nothing for the CPU.
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

/// alternate(), recorded and replayed. The results are those of alternate() but for the order of
/// atomic sums. A recording holds while the tensors of the state stay the same objects and the same
/// terms act; after densification the next step runs eagerly, the one after it is recorded anew.
/// Outputs are overwritten by the next run.
class StepGraph {
 public:
  StepGraph();
  ~StepGraph();
  StepGraph(const StepGraph&) = delete;
  StepGraph& operator=(const StepGraph&) = delete;

  /// False where a step depends on the host: on the CPU, for `deterministic`, learned poses and
  /// allocation per_view_map.
  static bool can_record(const RunOptions& options, torch::Device device);

  StepOutputs run(TrainState& state, const StepInputs& inputs, int64_t step,
                  const RunOptions& options);

  /// How many steps were replays of a recording.
  int64_t replays() const { return replays_; }

 private:
  struct Recording;
  std::unique_ptr<Recording> recording_;
  int64_t replays_ = 0;
};

}  // namespace jade::train
