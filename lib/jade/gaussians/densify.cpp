// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/densify.h"

#include <algorithm>
#include <cmath>

#include "jade/core/check.h"
#include "jade/gaussians/mcmc.h"
#include "jade/gaussians/regularization.h"

namespace jade::gaussians {
namespace {

constexpr double kResetOpacity = 0.01;
constexpr int kOpacity = 3;
constexpr int64_t kChildren = 2;
/// Number of densifications in the schedule of McmcOptions::growth: from 500 to 15,000, every 100.
constexpr double kMcmcDensifications = 145;

double logit(double p) { return std::log(p / (1 - p)); }

torch::Tensor largest_scale(const splat::Gaussians& values) {
  return values.log_scales.amax(1).exp();
}

/// Rows to grow; if only `room` fit, those with the largest screen gradient.
torch::Tensor growing_rows(const torch::Tensor& gradient, double threshold, int64_t room) {
  const torch::Tensor rows = (gradient >= threshold).nonzero().squeeze(1);
  if (rows.size(0) <= room) return rows;
  const torch::Tensor order =
      gradient.index_select(0, rows).argsort(/*stable=*/true, 0, /*descending=*/true);
  return std::get<0>(rows.index_select(0, order.slice(0, 0, std::max<int64_t>(0, room))).sort());
}

/// Two smaller children per row, sampled from the Gaussian itself.
splat::Gaussians split_children(const splat::Gaussians& values, const torch::Tensor& rows,
                                at::Generator& generator) {
  const torch::Tensor repeated = rows.repeat({kChildren});
  splat::Gaussians children = map_parameters(
      values, [&](const torch::Tensor& value) { return value.index_select(0, repeated); });
  const torch::Tensor normal =
      at::randn({repeated.size(0), 3}, generator, torch::kFloat32).to(values.means.device());
  children.means.add_(world_offsets(children.rotations, children.log_scales, normal));
  children.log_scales.sub_(kSplitShrink);
  return children;
}

/// Mask of Gaussians to keep: not too faint, not too large, finite.
torch::Tensor survivors(const splat::Gaussians& values, double extent, bool prune_large) {
  torch::Tensor keep = values.logit_opacities >= logit(kPruneOpacity);
  if (prune_large) keep = keep & (largest_scale(values) <= kPruneScale * extent);
  keep = keep & values.means.isfinite().all(1) & values.log_scales.isfinite().all(1);
  return keep.nonzero().squeeze(1);
}

}  // namespace

double mcmc_growth(const DensifyOptions& options) {
  const double densifications = static_cast<double>(options.until - options.from) /
                                static_cast<double>(static_cast<int64_t>(options.every));
  const double more = kMcmcDensifications / std::clamp(densifications, 1.0, kMcmcDensifications);
  return std::pow(1 + options.mcmc.growth, more);
}

namespace {

bool reads_statistics(const DensifyOptions& options) {
  return options.strategy == DensifyStrategy::kAdc ||
         (options.strategy == DensifyStrategy::kMcmc && options.mcmc.copies == McmcCopies::kSpread);
}

}  // namespace

bool keeps_statistics(const DensifyOptions& options, int64_t step) {
  return reads_statistics(options) && step < options.until;
}

void reset_opacities(GaussianModel& model, GaussianAdam& adam) {
  const torch::NoGradGuard no_grad;
  model.parameters().logit_opacities.detach().clamp_max_(logit(kResetOpacity));
  adam.reset_parameter(kOpacity);
}

Densifier::Densifier(const DensifyOptions& options, const GaussianModel& model,
                     at::Generator generator, double unit)
    : options_(options), generator_(std::move(generator)), unit_(unit) {
  reset_statistics(model);
}

void Densifier::reset_statistics(const GaussianModel& model) {
  statistics_ = {};
  if (!reads_statistics(options_)) return;
  statistics_ = splat::ScreenStatistics::zeros(model.size(), model.device());
}

bool Densifier::densify_due(int64_t step) const {
  return options_.strategy != DensifyStrategy::kNone && step > options_.from &&
         step < options_.until && step % options_.every == 0;
}

bool Densifier::opacity_reset_due(int64_t step) const {
  return options_.strategy == DensifyStrategy::kAdc && options_.opacity_reset_every > 0 &&
         step < options_.until && step <= options_.last_opacity_reset &&
         step % options_.opacity_reset_every == 0;
}

bool Densifier::due(int64_t step) const {
  return options_.strategy == DensifyStrategy::kMcmc || densify_due(step) ||
         opacity_reset_due(step);
}

DensifyReport Densifier::update(int64_t step, GaussianModel& model, GaussianAdam& adam,
                                double gradient_factor) {
  DensifyReport report;
  if (densify_due(step)) {
    const double threshold = options_.gradient_threshold * gradient_factor;
    report = options_.strategy == DensifyStrategy::kMcmc ? update_mcmc(model, adam)
                                                         : update_adc(step, threshold, model, adam);
  }
  if (opacity_reset_due(step)) {
    reset_opacities(model, adam);
    report.opacity_reset = true;
  }
  if (options_.strategy == DensifyStrategy::kMcmc) {
    const double lr = position_lr(adam.options(), step) * model.extent();
    // The noise of a mean is this factor times a covariance, which is the square of a length.
    add_noise(options_.mcmc.noise_lr * lr / (unit_ * unit_), model, generator_);
  }
  return report;
}

torch::Tensor Densifier::mean_gradient() const {
  return (statistics_.gradient_norm / statistics_.visible_count.clamp_min(1)).nan_to_num(0, 0, 0);
}

DensifyReport Densifier::update_adc(int64_t step, double gradient_threshold, GaussianModel& model,
                                    GaussianAdam& adam) {
  const torch::NoGradGuard no_grad;
  const splat::Gaussians values = model.detached();
  const torch::Tensor gradient = mean_gradient();
  check_shape(gradient, "densification statistics", {model.size()});
  const int64_t room = int64_t{options_.max_gaussians} - model.size();
  const torch::Tensor grow = growing_rows(gradient, gradient_threshold, room);
  const torch::Tensor large =
      largest_scale(values).index_select(0, grow) > kSplitScale * model.extent();
  const torch::Tensor cloned = grow.masked_select(~large);
  const torch::Tensor split = grow.masked_select(large);

  const torch::Tensor stays =
      torch::ones({model.size()}, gradient.options().dtype(torch::kBool)).index_fill_(0, split, 0);
  const torch::Tensor kept = stays.nonzero().squeeze(1);
  const splat::Gaussians children = split_children(values, split, generator_);
  splat::Gaussians grown;
  for (int i = 0; i < kParameterCount; ++i) {
    const torch::Tensor& value = parameter(values, i);
    parameter(grown, i) = torch::cat(
        {value.index_select(0, kept), value.index_select(0, cloned), parameter(children, i)});
  }
  const int64_t fresh = cloned.size(0) + kChildren * split.size(0);
  const torch::Tensor rows = torch::cat({kept, torch::full({fresh}, -1, kept.options())});

  const bool prune_large = options_.opacity_reset_every > 0 && step > options_.opacity_reset_every;
  const torch::Tensor alive = survivors(grown, model.extent(), prune_large);
  DensifyReport report;
  report.cloned = cloned.size(0);
  report.split = split.size(0);
  report.pruned = rows.size(0) - alive.size(0);
  if (report.changed()) {
    for (int i = 0; i < kParameterCount; ++i) {
      parameter(grown, i) = parameter(grown, i).index_select(0, alive);
    }
    model.replace(std::move(grown));
    adam.gather_rows(rows.index_select(0, alive));
  }
  reset_statistics(model);
  return report;
}

DensifyReport Densifier::update_mcmc(GaussianModel& model, GaussianAdam& adam) {
  const bool spread = options_.mcmc.copies == McmcCopies::kSpread;
  DensifyReport report;
  report.relocated = relocate_dead(
      {kPruneOpacity, spread, spread ? mean_gradient() : torch::Tensor()}, model, adam, generator_);
  // Clamp in floating point: the growth of few densifications exceeds any integer.
  const double wanted = std::min(static_cast<double>(int64_t{options_.max_gaussians}),
                                 static_cast<double>(model.size()) * mcmc_growth(options_));
  report.added = add_on_living(static_cast<int64_t>(wanted) - model.size(),
                               {kPruneOpacity, spread, {}}, model, adam, generator_);
  reset_statistics(model);
  return report;
}

torch::Tensor Densifier::regularization(const GaussianModel& model) const {
  if (options_.strategy != DensifyStrategy::kMcmc) return {};
  const splat::Gaussians& values = model.parameters();
  return mean_opacity_and_scale(values.logit_opacities, values.log_scales,
                                kMcmcOpacityRegularization, kMcmcScaleRegularization / unit_);
}

}  // namespace jade::gaussians
