// SPDX-License-Identifier: Apache-2.0
#include "jade/train/step_feed.h"

#include <algorithm>
#include <torch/types.h>

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
      pose_draws_(static_cast<uint64_t>(options.seed), device, options.exposure.samples,
                  draws_target_pose(options), std::max<int64_t>(restored_every(options), 1)),
      term_weights_(options.objective, calendar_steps(options), device),
      view_picks_(torch::arange(static_cast<int64_t>(views_.size()), torch::kInt64).to(device)) {
  const auto seed = static_cast<uint64_t>(options.seed);
  if (options.objective.event_loss_weight > 0) {
    event_windows_ = std::make_unique<EventWindows>(dataset, options.objective, seed, device);
  }
}

StepInputs StepFeed::at(int64_t step) {
  const int64_t index = order_.at(step);
  StepInputs inputs;
  inputs.step = step;
  inputs.view = views_[static_cast<size_t>(index)];
  inputs.view_index = index;
  inputs.pose_draws = pose_draws_.at(step);
  inputs.term_weights = term_weights_.at(step);
  inputs.view_pick = view_picks_.narrow(0, index, 1);
  const int64_t* const poses = pose_draws_.on_host(step);
  if (draws_target_pose(options_)) inputs.view = at_pose(inputs.view, poses[3], options_);
  leave_out_unread(options_, inputs.view);
  pick_factors(poses, &inputs);
  if (event_windows_) inputs.events = event_windows_->at(step, index);
  return inputs;
}

}  // namespace jade::train
