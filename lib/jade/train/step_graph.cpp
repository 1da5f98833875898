// SPDX-License-Identifier: Apache-2.0
#include "jade/train/step_graph.h"

#include <ATen/cuda/CUDAGraph.h>
#include <c10/cuda/CUDAGuard.h>
#include <c10/cuda/CUDAStream.h>
#include <optional>
#include <torch/types.h>

#include "jade/core/device.h"
#include "jade/core/error.h"
#include "jade/core/log.h"

namespace jade::train {
namespace {

/// A recording is made anew after so many steps, with room for the splats of the scene as it has
/// become.
constexpr int64_t kRenewal = 1000;

/// What the allocator may keep beyond a second set of all tensors: less, and it would ask the
/// driver anew at every recording.
constexpr int64_t kSpareBytes = int64_t{512} << 20;

}  // namespace

/// Everything that a recording takes for granted.
struct Assumptions {
  StepPlan plan;
  /// The renewal at hand, where each tensor of the state lies, and which shapes the inputs have:
  /// their values are copied before a replay.
  std::vector<int64_t> buffers;

  friend bool operator==(const Assumptions& a, const Assumptions& b) {
    return a.plan == b.plan && a.buffers == b.buffers;
  }
  friend bool operator!=(const Assumptions& a, const Assumptions& b) { return !(a == b); }
};

namespace {

Assumptions assumptions(const TrainState& state, const StepInputs& inputs, const StepPlan& plan) {
  Assumptions now{plan, {inputs.step / kRenewal}};
  state.visit([&](const std::string&, const torch::Tensor& tensor) {
    now.buffers.push_back(tensor.defined() ? reinterpret_cast<int64_t>(tensor.const_data_ptr())
                                           : 0);
    now.buffers.push_back(tensor.defined() ? tensor.numel() : 0);
  });
  inputs.visit([&](const std::string&, const torch::Tensor& tensor) {
    now.buffers.push_back(tensor.defined() ? tensor.dim() : -1);
    if (!tensor.defined()) return;
    now.buffers.insert(now.buffers.end(), tensor.sizes().begin(), tensor.sizes().end());
  });
  return now;
}

/// The same inputs at addresses of their own, where a recorded step reads them.
StepInputs own_copy(const StepInputs& inputs) {
  StepInputs own = inputs;
  own.visit([](const std::string&, torch::Tensor& tensor) {
    if (tensor.defined()) tensor = tensor.clone();
  });
  return own;
}

/// The values of `from` at the addresses of `own`.
void copy_values(const StepInputs& from, StepInputs& own) {
  const torch::NoGradGuard no_grad;
  std::vector<const torch::Tensor*> sources;
  from.visit([&](const std::string&, const torch::Tensor& tensor) { sources.push_back(&tensor); });
  size_t next = 0;
  own.visit([&](const std::string&, torch::Tensor& tensor) {
    const torch::Tensor& source = *sources[next++];
    if (tensor.defined()) tensor.copy_(source, /*non_blocking=*/true);
  });
}

}  // namespace

struct StreamScope::Guard {
  explicit Guard(torch::Device device)
      : stream(c10::cuda::getStreamFromPool(false, device.index())) {}
  c10::cuda::CUDAStreamGuard stream;
};

StreamScope::StreamScope(torch::Device device) {
  if (!device.is_cuda()) return;
  guard_ = std::make_unique<Guard>(device);
}

StreamScope::~StreamScope() = default;

struct StepGraph::Recording {
  std::optional<Assumptions> seen;       ///< of the last eager step, which warmed everything up
  std::optional<Assumptions> holds_for;  ///< of the recording; none: there is none
  std::optional<at::cuda::CUDAGraph> graph;
  std::optional<StepInputs> inputs;  ///< what the recorded step reads
  StepOutputs outputs;
  bool refused = false;

  void forget() {
    holds_for.reset();
    outputs = {};
    graph.reset();
    inputs.reset();
  }

  void record(TrainState& state, const StepInputs& step_inputs, const StepPlan& plan,
              const RunOptions& options) {
    // The pools of earlier recordings stay reserved until somebody asks, and nobody can while a
    // recording is under way: after a hundred densifications they would fill the card.
    const torch::Device device = step_inputs.view.blurry.device();
    trim_device_memory(device, peak_memory_bytes(device) + kSpareBytes);
    inputs = own_copy(step_inputs);
    // Gradients must be born inside the recording, at addresses of its own.
    state.gaussians.zero_grad();
    state.allocation_adam.zero_grad();
    state.response_adam.zero_grad();
    if (state.poses) state.poses_adam.zero_grad();
    state.sensor_adam.zero_grad();
    graph.emplace();
    graph->capture_begin();
    try {
      outputs = alternate(state, *inputs, plan, options);
    } catch (...) {
      graph->capture_end();
      throw;
    }
    graph->capture_end();
  }
};

StepGraph::StepGraph() : recording_(std::make_unique<Recording>()) {}
StepGraph::~StepGraph() = default;

StepOutputs StepGraph::run(TrainState& state, const StepInputs& inputs, const StepPlan& plan,
                           const RunOptions& options) {
  Recording& recording = *recording_;
  if (recording.refused || !plan.recordable || !inputs.view.blurry.is_cuda()) {
    return alternate(state, inputs, plan, options);
  }
  Assumptions now = assumptions(state, inputs, plan);
  if (now != recording.holds_for && now != recording.seen) {
    recording.forget();
    recording.seen = std::move(now);
    return alternate(state, inputs, plan, options);
  }
  if (now != recording.holds_for) {
    try {
      recording.record(state, inputs, plan, options);
      recording.holds_for = std::move(now);
    } catch (const std::exception& failure) {
      // Nothing ran on the device, so the step can be done eagerly.
      log_warn(concat("steps are not recorded as a CUDA graph, which makes them slower: ",
                      failure.what()));
      recording.forget();
      recording.refused = true;
      return alternate(state, inputs, plan, options);
    }
  }
  copy_values(inputs, *recording.inputs);
  recording.graph->replay();
  ++replays_;
  return recording.outputs;
}

}  // namespace jade::train
