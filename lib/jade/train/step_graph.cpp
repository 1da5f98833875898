// SPDX-License-Identifier: Apache-2.0
#include "jade/train/step_graph.h"

#include <ATen/Context.h>
#include <ATen/cuda/CUDAGraph.h>
#include <algorithm>
#include <c10/cuda/CUDAGuard.h>
#include <c10/cuda/CUDAStream.h>
#include <optional>
#include <torch/types.h>

#include "jade/core/device.h"
#include "jade/core/error.h"
#include "jade/core/log.h"
#include "jade/kernel/launch.h"
#include "jade/train/batch_copy.h"

namespace jade::train {
namespace {

/// Graphs are captured again after this many steps, with capacity for the current number of splats.
constexpr int64_t kRenewal = 1000;

/// Cached memory that the allocator may keep beyond live tensors when a step is captured or runs
/// eagerly. The rest, left by earlier graphs and the restorer, returns to the driver.
constexpr int64_t kSpareBytes = int64_t{64} << 20;

/// Maximum number of plans with a graph: steps alternate between few.
constexpr size_t kMostPlans = 4;

/// Shapes of the inputs. Their values are copied before a replay.
std::vector<int64_t> shapes_of(const StepInputs& inputs) {
  std::vector<int64_t> shapes;
  inputs.visit([&](const std::string&, const torch::Tensor& tensor) {
    shapes.push_back(tensor.defined() ? tensor.dim() : -1);
    if (!tensor.defined()) return;
    shapes.insert(shapes.end(), tensor.sizes().begin(), tensor.sizes().end());
  });
  return shapes;
}

/// Assumptions of a graph besides the inputs' shapes: the current renewal and the address of each
/// tensor of the state.
std::vector<int64_t> assumptions(const TrainState& state, int64_t step) {
  std::vector<int64_t> now{step / kRenewal};
  state.visit([&](const std::string&, const torch::Tensor& tensor) {
    now.push_back(tensor.defined() ? reinterpret_cast<int64_t>(tensor.const_data_ptr()) : 0);
    now.push_back(tensor.defined() ? tensor.numel() : 0);
  });
  return now;
}

/// Copy of the inputs at fixed addresses, which a captured step reads.
StepInputs own_copy(const StepInputs& inputs) {
  StepInputs own = inputs;
  own.visit([](const std::string&, torch::Tensor& tensor) {
    if (tensor.defined()) tensor = tensor.clone();
  });
  return own;
}

/// Whether both tensors have the same memory layout.
bool same_layout(const torch::Tensor& a, const torch::Tensor& b) {
  return a.scalar_type() == b.scalar_type() && a.device() == b.device() && a.numel() == b.numel() &&
         a.is_contiguous() && b.is_contiguous();
}

/// Returns the memory that dropped graphs held. Gradients lie in the pool of the graph that
/// computed them and keep all of it reserved, so they go first.
void release_memory(TrainState& state, torch::Device device) {
  state.zero_grad();
  trim_device_memory(device, kSpareBytes);
}

/// Copies the values of `from` to the addresses of `own`.
void copy_values(const StepInputs& from, StepInputs& own) {
  const torch::NoGradGuard no_grad;
  std::vector<const torch::Tensor*> sources;
  from.visit([&](const std::string&, const torch::Tensor& tensor) { sources.push_back(&tensor); });
  std::vector<BufferCopy> copies;
  size_t next = 0;
  own.visit([&](const std::string&, torch::Tensor& tensor) {
    const torch::Tensor& source = *sources[next++];
    if (!tensor.defined()) return;
    if (same_layout(source, tensor)) {
      copies.push_back({source.const_data_ptr(), tensor.mutable_data_ptr(),
                        static_cast<int64_t>(tensor.nbytes())});
    } else {
      tensor.copy_(source, /*non_blocking=*/true);
    }
  });
  cuda::copy_all(copies);
}

}  // namespace

struct StreamScope::Guard {
  explicit Guard(torch::Device device)
      : stream(c10::cuda::getStreamFromPool(false, device.index())) {}
  c10::cuda::CUDAStreamGuard stream;
};

StreamScope::StreamScope(torch::Device device) {
  if (!device.is_cuda()) return;
  bound_stack_memory(device);
  // A step computes some gradients on side streams, and autograd waits for them. It would warn once
  // per run, on the terminal.
  at::globalContext().setWarnOnAccumulateGradStreamMismatch(false);
  guard_ = std::make_unique<Guard>(device);
}

StreamScope::~StreamScope() = default;

/// The captured step of one plan.
struct Recording {
  StepPlan plan;
  at::cuda::CUDAGraph graph;
  StepOutputs outputs;
};

struct StepGraph::Recordings {
  std::vector<int64_t> shapes;     ///< shapes of the inputs of all graphs and of `seen`
  std::vector<int64_t> holds_for;  ///< assumptions of all graphs
  /// Plans of eager steps, which initialised libraries and the op's count of instances.
  std::vector<StepPlan> seen;
  std::vector<std::unique_ptr<Recording>> recorded;  ///< oldest first
  std::optional<StepInputs> inputs;                  ///< inputs of the captured steps
  bool refused = false;

  void forget() {
    recorded.clear();
    inputs.reset();
  }

  /// Other input shapes need another warm-up; another scene, as after a densification, does not.
  void check(const TrainState& state, const StepInputs& step_inputs) {
    std::vector<int64_t> input_shapes = shapes_of(step_inputs);
    std::vector<int64_t> now = assumptions(state, step_inputs.step);
    if (input_shapes == shapes && now == holds_for) return;
    forget();
    if (input_shapes != shapes) seen.clear();
    shapes = std::move(input_shapes);
    holds_for = std::move(now);
  }

  Recording* find(const StepPlan& plan) {
    for (const auto& each : recorded) {
      if (each->plan == plan) return each.get();
    }
    return nullptr;
  }

  /// Whether the plan has run once, so that it can be captured; marks it as run.
  bool warmed_up(const StepPlan& plan) {
    if (std::find(seen.begin(), seen.end(), plan) != seen.end()) return true;
    if (seen.size() == kMostPlans) seen.erase(seen.begin());
    seen.push_back(plan);
    return false;
  }

  Recording& record(TrainState& state, const StepInputs& step_inputs, const StepPlan& plan,
                    const RunOptions& options) {
    // The memory pools of earlier graphs stay reserved until trimmed, which is impossible during
    // capture: after a hundred densifications they would fill the GPU.
    if (recorded.size() == kMostPlans) recorded.erase(recorded.begin());
    // Gradients must be allocated inside the graph, at addresses of its own.
    release_memory(state, step_inputs.view.measured.device());
    if (!inputs) inputs = own_copy(step_inputs);
    auto made = std::make_unique<Recording>();
    made->plan = plan;
    // All graphs share one memory pool: they never run at the same time, and a step's outputs are
    // read before the next one runs.
    // Capture is thread-local, because the viewer uses CUDA events on other threads.
    made->graph.capture_begin(
        recorded.empty() ? c10::MempoolId_t{0, 0} : recorded.front()->graph.pool(),
        cudaStreamCaptureModeThreadLocal);
    try {
      made->outputs = alternate(state, *inputs, plan, options);
    } catch (...) {
      made->graph.capture_end();
      throw;
    }
    made->graph.capture_end();
    recorded.push_back(std::move(made));
    return *recorded.back();
  }
};

StepGraph::StepGraph() : recordings_(std::make_unique<Recordings>()) {}
StepGraph::~StepGraph() = default;

void StepGraph::release(TrainState& state, torch::Device device) {
  recordings_->forget();
  release_memory(state, device);
}

StepOutputs StepGraph::run(TrainState& state, const StepInputs& inputs, const StepPlan& plan,
                           const RunOptions& options) {
  Recordings& recordings = *recordings_;
  const bool recordable = plan.recordable && !kernel::waits_for_launches();
  if (recordings.refused || !recordable || !inputs.view.measured.is_cuda()) {
    return alternate(state, inputs, plan, options);
  }
  recordings.check(state, inputs);
  Recording* recording = recordings.find(plan);
  if (recording == nullptr) {
    if (!recordings.warmed_up(plan)) {
      // An eager step does not need the memory of the graphs; both together would be the run's
      // peak.
      release(state, inputs.view.measured.device());
      return alternate(state, inputs, plan, options);
    }
    try {
      recording = &recordings.record(state, inputs, plan, options);
    } catch (const std::exception& failure) {
      // The device ran no part of the step, so it can run eagerly.
      log_warn(concat("steps are not recorded as a CUDA graph, which makes them slower: ",
                      failure.what()));
      recordings.forget();
      recordings.refused = true;
      return alternate(state, inputs, plan, options);
    }
  }
  copy_values(inputs, *recordings.inputs);
  recording->graph.replay();
  ++replays_;
  return recording->outputs;
}

}  // namespace jade::train
