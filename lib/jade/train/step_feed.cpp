// SPDX-License-Identifier: Apache-2.0
#include "jade/train/step_feed.h"

#include <algorithm>
#include <numeric>
#include <torch/types.h>

#include "jade/train/plan.h"
#include "jade/train/view_memory.h"

namespace jade::train {
namespace {

bool draws_target_pose(const RunOptions& options) {
  return restored_every(options) > 0 && options.objective.target != losses::Target::kNone;
}

/// Drops tensors that no step reads, so that they are not copied for the recorded step.
void leave_out_unread(const RunOptions& options, View& view) {
  view.density = torch::Tensor();
  if (options.objective.target == losses::Target::kRouted) return;
  view.psi = view.reblur_kernel = torch::Tensor();
  view.restorations = {};
}

}  // namespace

StepFeed::StepFeed(const data::Dataset& dataset, const RunOptions& options, torch::Device device,
                   std::future<restore::Restorer> early)
    : options_(options),
      views_(prepare_views(dataset, options, device, std::move(early))),
      order_(static_cast<uint64_t>(options.seed), static_cast<int64_t>(views_.size())),
      device_(device),
      term_weights_(options.objective, calendar_steps(options), device),
      view_picks_(torch::arange(static_cast<int64_t>(views_.size()), torch::kInt64).to(device)) {
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
  inputs.view = with_frame(views_[static_cast<size_t>(index)], device_);
  inputs.view_index = index;
  inputs.pose_draws = pose_draws_.at(step);
  inputs.term_weights = term_weights_.at(step);
  inputs.view_pick = view_picks_.narrow(0, index, 1);
  const int64_t* const poses = pose_draws_.on_host(step);
  if (draws_target_pose(options_)) inputs.view = at_pose(inputs.view, stride_ * poses[3], options_);
  leave_out_unread(options_, inputs.view);
  pick_factors(poses, stride_, &inputs);
  thin(inputs.view);
  if (event_windows_) inputs.events = event_windows_->at(step, index);
  return inputs;
}

}  // namespace jade::train
