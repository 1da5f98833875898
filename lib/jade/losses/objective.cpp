// SPDX-License-Identifier: Apache-2.0
#include "jade/losses/objective.h"

#include "jade/core/check.h"
#include "jade/losses/poses.h"
#include "jade/losses/target.h"

namespace jade::losses {
namespace {

constexpr int64_t kPoses = 9;
constexpr int64_t kMidPose = 4;

void add(Objective& loss, const std::string& name, const torch::Tensor& value, double weight = 1) {
  const torch::Tensor weighted = weight == 1 ? value : value * weight;
  loss.terms.push_back({name, weighted});
  loss.total = loss.total.defined() ? loss.total + weighted : weighted;
}

/// The renders that the terms share, toned once.
struct Views {
  torch::Tensor mean, mid, edi_gray, edi_color, simulation;  ///< [3,H,W]; undefined: not rendered
};

/// The rows of poses_read(), in its order.
Views unpack_views(const ObjectiveInputs& inputs, int64_t step, const ObjectiveOptions& options) {
  const std::vector<torch::Tensor> rendered = inputs.renders.unbind(0);
  size_t next = 0;
  Views views;
  if (target_acts(options, step)) views.mid = rendered.at(next++);
  if (options.edi_supervision) {
    views.edi_gray = rendered.at(next++);
    views.edi_color = rendered.at(next++);
  }
  return views;
}

Views pick_views(const ObjectiveInputs& inputs, int64_t step, const ObjectiveOptions& options) {
  if (inputs.renders.size(0) != kPoses) return unpack_views(inputs, step, options);
  const torch::Tensor mid = torch::full({1}, kMidPose, inputs.poses.options());
  const PoseViews views = pose_views(inputs.renders, torch::cat({mid, inputs.poses}));
  const std::vector<torch::Tensor> picks = views.picks.unbind(0);
  return {views.mean, picks[0], picks[1], picks[2], picks[3]};
}

void check_inputs(const ObjectiveInputs& inputs, int64_t step, const ObjectiveOptions& options) {
  check_shape(inputs.renders, "renders", {-1, 3, -1, -1});
  check_shape(inputs.poses, "poses", {3});
  const torch::Tensor read = poses_read(options, step, inputs.poses);
  const int64_t count = inputs.renders.size(0);
  JADE_CHECK(count == kPoses || (read.defined() && count == read.size(0)), "expected renders of ",
             read.defined() ? read.size(0) : kPoses, " poses, found ", count);
  const int64_t height = inputs.renders.size(2), width = inputs.renders.size(3);
  check_shape(inputs.blurry, "blurry frame", {3, height, width});
  if (options.edi_supervision || options.simulation) {
    check_shape(inputs.edi_factors, "EDI factors", {kPoses, 1, height, width});
  }
}

}  // namespace

bool target_acts(const ObjectiveOptions& options, int64_t step) {
  return options.target != "none" && (options.target_until == 0 || step <= options.target_until);
}

torch::Tensor poses_read(const ObjectiveOptions& options, int64_t step,
                         const torch::Tensor& draws) {
  if (options.blur || simulation_acts(options, step) || intensity_acts(options, step)) return {};
  std::vector<torch::Tensor> read;
  if (target_acts(options, step)) read.push_back(torch::full({1}, kMidPose, draws.options()));
  if (options.edi_supervision) read.push_back(draws.narrow(0, 0, 2));
  return read.empty() ? torch::Tensor() : torch::cat(read);
}

bool simulation_acts(const ObjectiveOptions& options, int64_t step) {
  return options.simulation && step > options.simulation_start;
}

bool intensity_acts(const ObjectiveOptions& options, int64_t step) {
  return options.intensity && step > options.warmup;
}

bool tone_acts(const ObjectiveOptions& options, int64_t step) {
  return step > options.warmup && (options.edi_supervision || simulation_acts(options, step) ||
                                   options.intensity || options.event_loss_weight > 0);
}

Objective objective(const ObjectiveInputs& inputs, int64_t step, const ObjectiveOptions& options) {
  check_inputs(inputs, step, options);
  const bool toned = tone_acts(options, step);
  const auto tone = [&](const torch::Tensor& image) {
    return toned && inputs.tone.apply ? inputs.tone.apply(image) : image;
  };
  const Views views = pick_views(inputs, step, options);
  const auto mean_toned = [&] {
    if (!toned || !inputs.tone.apply) return views.mean;
    return inputs.tone.mean ? inputs.tone.mean(inputs.renders) : tone(inputs.renders).mean(0);
  };
  const torch::Tensor& blurry = inputs.blurry;
  const auto edi_factor = [&](int64_t draw) {
    return inputs.edi_factors.index_select(0, inputs.poses.narrow(0, draw, 1)).squeeze(0);
  };
  torch::Tensor toned_blurry;
  if (options.edi_supervision || intensity_acts(options, step)) toned_blurry = tone(blurry);

  Objective loss;
  if (inputs.target && target_acts(options, step)) {
    add(loss, "target", target_loss(views.mid, *inputs.target, options.dssim),
        options.target_weight);
  }
  if (options.blur) {
    const bool prepared = inputs.blurry_moments.mean.defined();
    add(loss, "blur",
        prepared ? blur_loss(views.mean, inputs.blurry_moments, options.dssim)
                 : blur_loss(views.mean, blurry, options.dssim));
  }
  if (options.edi_supervision) {
    add(loss, "edi_gray",
        edi_gray_loss(tone(views.edi_gray), toned_blurry, edi_factor(0), options.dssim));
    add(loss, "edi_color", edi_color_loss(views.edi_color, blurry, edi_factor(1), options.dssim));
  }
  if (simulation_acts(options, step)) {
    add(loss, "simulation",
        simulation_loss(tone(views.simulation), tone(views.mean), edi_factor(2), options.dssim));
  }
  if (intensity_acts(options, step)) {
    add(loss, "intensity", intensity_loss(mean_toned(), toned_blurry, options.dssim));
  }
  if (inputs.events) {
    add(loss, "event", event_loss(*inputs.events), options.event_loss_weight);
  }
  return loss;
}

}  // namespace jade::losses
