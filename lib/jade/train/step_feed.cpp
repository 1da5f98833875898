// SPDX-License-Identifier: Apache-2.0
#include "jade/train/step_feed.h"

#include <algorithm>
#include <optional>
#include <torch/types.h>

#include "jade/train/plan.h"

namespace jade::train {
namespace {

bool draws_target_pose(const RunOptions& options) {
  return restored_every(options) > 0 && options.objective.target != losses::Target::kNone;
}

}  // namespace

StepFeed::StepFeed(const data::Dataset& dataset, const RunOptions& options, torch::Device device,
                   std::unique_ptr<Restoring> begun, int64_t most_device_bytes)
    : options_(options),
      bank_(dataset, options, device, std::move(begun), most_device_bytes),
      order_(static_cast<uint64_t>(options.seed), bank_.size()),
      device_(device),
      term_weights_(options.objective, calendar_steps(options), device),
      view_picks_(torch::arange(bank_.size(), torch::kInt64).to(device)) {
  const auto seed = static_cast<uint64_t>(options.seed);
  if (options.objective.event_loss_weight > 0) {
    event_windows_ = std::make_unique<EventWindows>(dataset, options.objective, seed, device);
  }
}

void StepFeed::set_stride(int64_t stride) {
  if (stride == stride_) return;
  stride_ = stride;
  const auto& exposure = options_.exposure;
  const int64_t restored = std::max<int64_t>(restored_every(options_), 1);
  pose_draws_ =
      PoseDraws(static_cast<uint64_t>(options_.seed), device_, (exposure.samples - 1) / stride + 1,
                draws_target_pose(options_), std::lcm(stride, restored) / stride);
  weights_ = torch::Tensor();
  if (stride == 1) return;
  const geometry::Quadrature some =
      geometry::thinned(geometry::quadrature(exposure.quadrature, exposure.samples), stride);
  weights_ = torch::tensor(some.weights, torch::kFloat64).to(device_, torch::kFloat32);
}

void StepFeed::thin(View& view) const {
  if (stride_ == 1) return;
  for (torch::Tensor* const each :
       {&view.cameras.camera_from_world, &view.cameras.intrinsics, &view.u}) {
    *each = each->slice(0, 0, each->size(0), stride_).contiguous();
  }
  view.weights = weights_;
}

StepInputs StepFeed::at(int64_t step) {
  set_stride(plan_step(options_, step).moment_stride);
  const int64_t index = order_.at(step);
  StepInputs inputs;
  inputs.step = step;
  inputs.view_index = index;
  inputs.pose_draws = pose_draws_.at(step);
  inputs.term_weights = term_weights_.at(step);
  inputs.view_pick = view_picks_.narrow(0, index, 1);
  const int64_t* const poses = pose_draws_.on_host(step);
  std::optional<int64_t> target_pose;
  if (draws_target_pose(options_)) target_pose = stride_ * poses[3];
  inputs.view = bank_.step_view(index, target_pose);
  inputs.edi_factors =
      bank_.edi_factors(index, {stride_ * poses[0], stride_ * poses[1], stride_ * poses[2]});
  thin(inputs.view);
  if (event_windows_) inputs.events = event_windows_->at(step, index);
  return inputs;
}

}  // namespace jade::train
