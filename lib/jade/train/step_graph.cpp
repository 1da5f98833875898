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

/// The tensors that a step reads from its view, in a fixed order.
std::vector<torch::Tensor*> tensors_of(View& view) {
  return {&view.blurry,
          &view.blurry_moments.image,
          &view.blurry_moments.mean,
          &view.blurry_moments.square,
          &view.psi,
          &view.edi_factors,
          &view.reblur_kernel,
          &view.restorations.edi,
          &view.restorations.efnet,
          &view.fixed_target,
          &view.cameras.camera_from_world,
          &view.cameras.intrinsics};
}

std::vector<torch::Tensor*> tensors_of(EventWindow& window) {
  return {&window.cameras.camera_from_world, &window.cameras.intrinsics, &window.counts,
          &window.pixels};
}

/// Everything that a recording takes for granted.
std::vector<int64_t> assumptions(const TrainState& state, const StepInputs& inputs, int64_t step,
                                 const RunOptions& options) {
  std::vector<int64_t> all{step / kRenewal,
                           gaussians::active_sh_degree(step, options.train.sh_degree_every),
                           losses::tone_acts(options.objective, step),
                           losses::target_acts(options.objective, step),
                           losses::simulation_acts(options.objective, step),
                           losses::intensity_acts(options.objective, step),
                           inputs.events.defined(),
                           inputs.view.blurry.size(1),
                           inputs.view.blurry.size(2)};
  const auto address = [&](const torch::Tensor& tensor) {
    all.push_back(tensor.defined() ? reinterpret_cast<int64_t>(tensor.const_data_ptr()) : 0);
    all.push_back(tensor.defined() ? tensor.numel() : 0);
  };
  for (int i = 0; i < gaussians::kParameterCount; ++i) {
    address(gaussians::parameter(state.gaussians.parameters(), i));
    address(gaussians::parameter(state.gaussian_adam.first_moments(), i));
    address(gaussians::parameter(state.gaussian_adam.second_moments(), i));
  }
  const splat::ScreenStatistics statistics = state.densifier.statistics(step);
  address(statistics.gradient_norm);
  address(statistics.visible_count);
  address(statistics.max_radius_px);
  return all;
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
  /// The addresses that a recorded step reads from, where its inputs are copied before a replay.
  struct StaticInputs {
    View view;
    EventWindow events;
    torch::Tensor poses;

    explicit StaticInputs(const StepInputs& inputs)
        : view(inputs.view), events(inputs.events), poses(inputs.poses.clone()) {
      for (torch::Tensor* tensor : all()) {
        if (tensor->defined()) *tensor = tensor->clone();
      }
    }

    std::vector<torch::Tensor*> all() {
      std::vector<torch::Tensor*> tensors = tensors_of(view);
      for (torch::Tensor* tensor : tensors_of(events)) tensors.push_back(tensor);
      return tensors;
    }

    void copy_from(const StepInputs& inputs) {
      const torch::NoGradGuard no_grad;
      View from_view = inputs.view;
      EventWindow from_events = inputs.events;
      std::vector<torch::Tensor*> from = tensors_of(from_view);
      for (torch::Tensor* tensor : tensors_of(from_events)) from.push_back(tensor);
      const std::vector<torch::Tensor*> to = all();
      for (size_t i = 0; i < to.size(); ++i) {
        if (to[i]->defined()) to[i]->copy_(*from[i], /*non_blocking=*/true);
      }
      poses.copy_(inputs.poses, /*non_blocking=*/true);
    }
  };

  std::vector<int64_t> seen;  ///< assumptions of the last eager step, which warmed everything up
  std::vector<int64_t> holds_for;  ///< assumptions of the recording; empty: there is none
  std::optional<at::cuda::CUDAGraph> graph;
  std::optional<StaticInputs> inputs;
  StepOutputs outputs;
  bool refused = false;

  void forget() {
    holds_for.clear();
    outputs = {};
    graph.reset();
    inputs.reset();
  }

  void record(TrainState& state, const StepInputs& step_inputs, int64_t step,
              const RunOptions& options) {
    // The pools of earlier recordings stay reserved until somebody asks, and nobody can while a
    // recording is under way: after a hundred densifications they would fill the card.
    const torch::Device device = step_inputs.view.blurry.device();
    trim_device_memory(device, peak_memory_bytes(device) + kSpareBytes);
    inputs.emplace(step_inputs);
    // Gradients must be born inside the recording, at addresses of its own.
    state.gaussians.zero_grad();
    state.allocation_adam.zero_grad();
    state.response_adam.zero_grad();
    graph.emplace();
    graph->capture_begin();
    try {
      outputs =
          alternate(state, {inputs->view, step_inputs.view_index, inputs->poses, inputs->events},
                    step, options);
    } catch (...) {
      graph->capture_end();
      throw;
    }
    graph->capture_end();
  }
};

StepGraph::StepGraph() : recording_(std::make_unique<Recording>()) {}
StepGraph::~StepGraph() = default;

bool StepGraph::can_record(const RunOptions& options, torch::Device device) {
  return device.is_cuda() && options.train.cuda_graph && !options.deterministic &&
         options.poses.optimize == "none" && options.allocation.kind != "per_view_map";
}

StepOutputs StepGraph::run(TrainState& state, const StepInputs& inputs, int64_t step,
                           const RunOptions& options) {
  Recording& recording = *recording_;
  std::vector<int64_t> now = assumptions(state, inputs, step, options);
  if (recording.refused || (now != recording.holds_for && now != recording.seen)) {
    recording.forget();
    recording.seen = std::move(now);
    return alternate(state, inputs, step, options);
  }
  if (now != recording.holds_for) {
    try {
      recording.record(state, inputs, step, options);
      recording.holds_for = std::move(now);
    } catch (const std::exception& failure) {
      // Nothing ran on the device, so the step can be done eagerly.
      log_warn(concat("steps are not recorded as a CUDA graph, which makes them slower: ",
                      failure.what()));
      recording.forget();
      recording.refused = true;
      return alternate(state, inputs, step, options);
    }
  }
  recording.inputs->copy_from(inputs);
  recording.graph->replay();
  ++replays_;
  return recording.outputs;
}

}  // namespace jade::train
