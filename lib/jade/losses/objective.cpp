// SPDX-License-Identifier: Apache-2.0
#include "jade/losses/objective.h"

#include <algorithm>

#include "jade/core/check.h"
#include "jade/imaging/color.h"
#include "jade/losses/poses.h"

namespace jade::losses {
namespace {

/// Sampled poses of L_edi gray, L_edi colour and L_sim; that of L_tgt follows them.
constexpr int64_t kTermDraws = 3;

/// The reconstruction terms of an objective, evaluated in one pass.
class Terms {
 public:
  /// @param falling  the weight of this step if it changes during the run
  void add(const std::string& name, std::vector<imaging::L1SsimPair> pairs, double weight = 1,
           const torch::Tensor& falling = {}) {
    names_.push_back(name);
    terms_.push_back({std::move(pairs), falling.defined() ? 1 : weight, falling});
  }

  void sum_up(double dssim, Objective* loss) const {
    if (terms_.empty()) return;
    const imaging::L1SsimSum sum = imaging::l1_ssim_sum(terms_, dssim);
    for (size_t i = 0; i < names_.size(); ++i) {
      loss->terms.push_back({names_[i], sum.terms[static_cast<int64_t>(i)]});
    }
    loss->total = loss->total.defined() ? loss->total + sum.total : sum.total;
  }

 private:
  std::vector<std::string> names_;
  std::vector<imaging::L1SsimTerm> terms_;
};

/// Adds a term that is already a scalar.
void add(Objective& loss, const std::string& name, const torch::Tensor& value, double weight,
         const torch::Tensor& falling = {}) {
  const torch::Tensor weighted = falling.defined() ? value * falling
                                 : weight == 1     ? value
                                                   : value * weight;
  loss.terms.push_back({name, weighted});
  loss.total = loss.total.defined() ? loss.total + weighted : weighted;
}

/// Assigns the rows of poses_read(), in its order.
Views unpack_views(const torch::Tensor& renders, const ObjectivePlan& plan) {
  const std::vector<torch::Tensor> rendered = renders.unbind(0);
  size_t next = 0;
  Views views;
  views.all = renders;
  if (plan.target) views.target = rendered.at(next++);
  if (plan.edi) {
    views.edi_gray = rendered.at(next++);
    views.edi_color = rendered.at(next++);
  }
  return views;
}

/// Images under ρ that the terms read; undefined if unused. Gray ones are g(ρ(·)), [1,H,W].
struct Toned {
  torch::Tensor blurry, edi_gray, mean_gray, simulation_gray;
  torch::Tensor mean;  ///< Σ_k w_k ρ(Î_k), of all renders
};

/// Weights of ToneInput that compute g(ρ(·)) of an image [3,1,H,W].
torch::Tensor gray_weights(const torch::Tensor& like) {
  const double* const weights = imaging::kGrayWeights;
  return torch::tensor({weights[0], weights[1], weights[2]}, torch::kFloat64)
      .to(like.scalar_type());
}

/// Weights of the mean render.
torch::Tensor mean_weights(const ObjectiveInputs& inputs) {
  if (inputs.weights.defined()) return inputs.weights;
  const int64_t count = inputs.renders.size(0);
  auto options = inputs.renders.options().requires_grad(false);
  if (count <= ToneInput::kMostOnCpu) options = options.device(torch::kCPU);
  return torch::full({count}, 1 / static_cast<double>(count), options);
}

/// Applies ρ in one call, or the identity if the plan or the inputs have none.
Toned tone(const ObjectiveInputs& inputs, const Views& views, const ObjectivePlan& plan) {
  Toned toned;
  if (!plan.response || !inputs.tone) {
    toned.blurry = inputs.blurry.image;
    if (plan.edi) toned.edi_gray = imaging::gray(views.edi_gray);
    if (plan.simulation) {
      toned.mean_gray = imaging::gray(views.mean);
      toned.simulation_gray = imaging::gray(views.simulation);
    }
    toned.mean = views.mean;
    return toned;
  }
  std::vector<ToneInput> asked;
  std::vector<torch::Tensor*> answers;
  const auto ask = [&](torch::Tensor& answer, const torch::Tensor& image,
                       const torch::Tensor& weights) {
    asked.push_back({image, weights});
    answers.push_back(&answer);
  };
  const torch::Tensor gray = gray_weights(inputs.renders);
  if (plan.edi || plan.intensity) ask(toned.blurry, inputs.blurry.image, {});
  if (plan.edi) ask(toned.edi_gray, views.edi_gray.unsqueeze(1), gray);
  if (plan.simulation) {
    ask(toned.mean_gray, views.mean.unsqueeze(1), gray);
    ask(toned.simulation_gray, views.simulation.unsqueeze(1), gray);
  }
  if (plan.intensity) ask(toned.mean, views.all, mean_weights(inputs));
  if (asked.empty()) return toned;
  const std::vector<torch::Tensor> results = inputs.tone(asked);
  const torch::Tensor& mask = inputs.mask;
  for (size_t i = 0; i < results.size(); ++i) {
    *answers[i] = mask.defined() ? results[i] * mask : results[i];
  }
  return toned;
}

void check_inputs(const ObjectiveInputs& inputs, const ObjectivePlan& plan) {
  check_shape(inputs.renders, "renders", {-1, 3, -1, -1});
  const torch::Tensor read = poses_read(plan, inputs.pose_draws, inputs.samples);
  const int64_t count = inputs.renders.size(0);
  JADE_CHECK(count == inputs.samples || (read.defined() && count == read.size(0)),
             "expected renders of ", read.defined() ? read.size(0) : inputs.samples,
             " poses, found ", count);
  const int64_t height = inputs.renders.size(2), width = inputs.renders.size(3);
  check_shape(inputs.blurry.image, "blurry frame", {3, height, width});
  const EdiFactors& factors = inputs.edi_factors;
  if (plan.edi) {
    check_shape(factors.gray, "EDI factors of L_edi gray", {1, height, width});
    check_shape(factors.color, "EDI factors of L_edi colour", {1, height, width});
  }
  if (plan.simulation) check_shape(factors.simulation, "EDI factors of L_sim", {1, height, width});
  JADE_CHECK(inputs.target || !plan.target, "L_tgt acts: expected a target, found none");
  JADE_CHECK(inputs.events || !plan.event, "L_ev acts: expected a window of events, found none");
}

}  // namespace

ObjectivePlan plan_objective(const ObjectiveOptions& options, int64_t step) {
  const bool warm = step > options.warmup;
  ObjectivePlan plan;
  const bool over = options.target_until != 0 && step > options.target_until;
  plan.target = options.target != Target::kNone && (!over || options.trust.agreement > 0);
  plan.agreed_target = plan.target && over;
  plan.drawn_target = plan.target && options.restored_poses != RestoredPoses::kMiddle;
  plan.blur = options.blur;
  plan.edi = options.edi_supervision;
  plan.simulation = options.simulation && step > options.simulation_start;
  plan.intensity = options.intensity && warm;
  plan.event = options.event_loss_weight > 0;
  plan.response = warm && (plan.edi || plan.simulation || plan.intensity || plan.event);
  return plan;
}

bool weights_fall(const ObjectiveOptions& options) { return options.edi_weight_final >= 0; }

std::array<double, 2> term_weights(const ObjectiveOptions& options, int64_t step, int64_t steps) {
  const double share =
      std::min(1.0, static_cast<double>(step) / static_cast<double>(std::max<int64_t>(1, steps)));
  const double last = options.edi_weight_final;
  return {options.target_weight, last < 0 ? kEdiWeight : kEdiWeight + share * (last - kEdiWeight)};
}

torch::Tensor target_pose(const ObjectivePlan& plan, const torch::Tensor& pose_draws,
                          int64_t samples) {
  return plan.drawn_target ? pose_draws.narrow(0, kTermDraws, 1)
                           : torch::full({1}, samples / 2, pose_draws.options());
}

torch::Tensor poses_read(const ObjectivePlan& plan, const torch::Tensor& pose_draws,
                         int64_t samples) {
  const int64_t draws = pose_draws.numel();
  JADE_CHECK(draws == kTermDraws + 1 || (draws == kTermDraws && !plan.drawn_target),
             "expected 3 sampled poses, 4 where that of L_tgt is sampled, found ", draws);
  if (plan.all_poses()) return {};
  std::vector<torch::Tensor> read;
  if (plan.target) read.push_back(target_pose(plan, pose_draws, samples));
  if (plan.edi) read.push_back(pose_draws.narrow(0, 0, 2));
  return torch::cat(read);
}

Views pick_views(const ObjectiveInputs& inputs, const ObjectivePlan& plan) {
  check_inputs(inputs, plan);
  if (inputs.renders.size(0) != inputs.samples) return unpack_views(inputs.renders, plan);
  if (plan.drawn_target) {
    const PoseViews views = pose_views(inputs.renders, inputs.pose_draws, inputs.weights);
    const std::vector<torch::Tensor>& picks = views.picks;
    return {views.all, views.mean, picks[kTermDraws], picks[0], picks[1], picks[2]};
  }
  const PoseViews views = pose_views(inputs.renders, inputs.pose_draws.narrow(0, 0, kTermDraws),
                                     inputs.weights, inputs.samples / 2);
  const std::vector<torch::Tensor>& picks = views.picks;
  return {views.all, views.mean, picks[0], picks[1], picks[2], picks[3]};
}

Objective objective(const ObjectiveInputs& inputs, const ObjectivePlan& plan,
                    const ObjectiveOptions& options) {
  return objective(pick_views(inputs, plan), inputs, plan, options);
}

Objective objective(const Views& views, const ObjectiveInputs& inputs, const ObjectivePlan& plan,
                    const ObjectiveOptions& options) {
  torch::Tensor target_weight, edi_weight;  // defined if the weights change
  if (inputs.term_weights.defined()) {
    target_weight = inputs.term_weights[0];
    edi_weight = inputs.term_weights[1];
  }

  Objective loss;
  Terms terms;
  if (plan.agreed_target) {
    const torch::Tensor value = target_loss(views.target, *inputs.target, options.dssim);
    add(loss, "target", where_agreed(value, options.trust.agreement), options.target_weight,
        target_weight);
    loss.terms.push_back({"target_distance", value.detach(), false});
  } else if (plan.target) {
    terms.add("target", target_pairs(views.target, *inputs.target), options.target_weight,
              target_weight);
  }
  const Toned toned = tone(inputs, views, plan);
  if (plan.blur) terms.add("blur", {blur_pair(views.mean, inputs.blurry)});
  if (plan.edi) {
    terms.add("edi_gray", {edi_gray_pair(toned.edi_gray, toned.blurry, inputs.edi_factors.gray)},
              kEdiWeight, edi_weight);
    terms.add("edi_color",
              {edi_color_pair(views.edi_color, inputs.blurry.image, inputs.edi_factors.color)},
              kEdiWeight, edi_weight);
  }
  if (plan.simulation) {
    terms.add("simulation", {simulation_pair(toned.simulation_gray, toned.mean_gray,
                                             inputs.edi_factors.simulation)});
  }
  if (plan.intensity) terms.add("intensity", {intensity_pair(toned.mean, toned.blurry)});
  terms.sum_up(options.dssim, &loss);
  if (plan.event) add(loss, "event", event_loss(*inputs.events), options.event_loss_weight);
  return loss;
}

}  // namespace jade::losses
