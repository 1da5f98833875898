// SPDX-License-Identifier: Apache-2.0
#include "jade/data/threshold_estimate.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>

#include "jade/core/interrupt.h"
#include "jade/events/counts.h"
#include "jade/imaging/color.h"

namespace jade::data {
namespace {

constexpr double kDark = 0.04;
constexpr double kBright = 0.96;
constexpr int64_t kMoments = 17;  // per exposure
constexpr int64_t kMostExposures = 25;
constexpr int64_t kMostPixels = 8000;
constexpr int kRounds = 30;
constexpr double kHuber = 2;  // in deviations of the residual
constexpr double kSmallest = 0.01, kLargest = 3;

/// What P pixels saw in V exposures, float64.
struct Series {
  torch::Tensor positive, negative;  ///< [P,V,K] events since the first exposure began
  torch::Tensor change;              ///< [P,V−1] of the logarithm of the frames
  torch::Tensor usable;              ///< [P,V−1] bool
};

/// A run of neighbours: the middle of the recording, where cameras move most.
std::vector<Exposure> middle_of(const std::vector<Exposure>& exposures) {
  const size_t count = std::min(exposures.size(), size_t(kMostExposures));
  const auto begin = exposures.begin() + std::ptrdiff_t((exposures.size() - count) / 2);
  return {begin, begin + std::ptrdiff_t(count)};
}

/// Over long gaps, noise events outweigh what the frames can tell. Exposures whose times were
/// rounded overlap a little.
bool is_neighbour(const Exposure& a, const Exposure& b) {
  const int64_t gap = b.t_start_us - a.t_end_us;
  return gap >= -a.duration_us() / 20 && gap <= std::max<int64_t>(3 * a.duration_us(), 100000);
}

/// Evenly chosen pixels among those that have events.
torch::Tensor chosen_pixels(const events::EventStream& events, const events::ImageSize& size) {
  const torch::Tensor active =
      (events::event_density(events, size).flatten() >= 1).nonzero().flatten();
  const int64_t count = std::min(active.numel(), kMostPixels);
  if (count == 0) return active;
  const torch::Tensor places =
      (torch::arange(count, torch::kFloat64) * (double(active.numel()) / double(count)))
          .to(torch::kInt64);
  return active.index_select(0, places);
}

/// Times of the moments of an exposure, then the next exposure's start.
std::vector<int64_t> knots_from(const Exposure& exposure, int64_t next_us) {
  std::vector<int64_t> knots;
  const events::TimeWindow window{exposure.t_start_us, exposure.t_end_us};
  for (int64_t k = 0; k < kMoments; ++k) knots.push_back(events::knot_us(window, k, kMoments - 1));
  knots.push_back(std::max(next_us, knots.back()));
  return knots;
}

/// Events of each span at the chosen pixels, [S,2,P] float64.
torch::Tensor counts_at(const torch::Tensor& pixels, const events::EventStream& events,
                        const std::vector<int64_t>& knots, const events::ImageSize& size) {
  const torch::Tensor counts = events::count_events(events, knots, size);
  return events::to_events(counts.flatten(2).index_select(2, pixels)).to(torch::kFloat64);
}

Series series_of(const std::vector<Exposure>& exposures, const events::EventStream& events,
                 double log_offset) {
  const torch::Tensor& frame = exposures.front().blurry;
  const events::ImageSize size{frame.size(-2), frame.size(-1)};
  const torch::Tensor pixels =
      chosen_pixels(events.slice(exposures.front().t_start_us, exposures.back().t_end_us), size);
  std::vector<torch::Tensor> sums, logs, good;
  torch::Tensor before = torch::zeros({1, 2, pixels.numel()}, torch::kFloat64);
  for (size_t i = 0; i < exposures.size(); ++i) {
    const Exposure& exposure = exposures[i];
    const bool last = i + 1 == exposures.size();
    const int64_t next_us = last ? exposure.t_end_us : exposures[i + 1].t_start_us;
    const torch::Tensor some = counts_at(pixels, events, knots_from(exposure, next_us), size);
    const torch::Tensor until = torch::cat({before, before + some.cumsum(0)});  // [K+1,2,P]
    sums.push_back(until.slice(0, 0, kMoments));
    before = until.slice(0, kMoments, kMoments + 1);
    if (next_us < exposure.t_end_us) {  // the next exposure counts these again
      before = before - counts_at(pixels, events, {next_us, exposure.t_end_us}, size);
    }
    const torch::Tensor gray =
        imaging::gray(exposure.blurry).to(torch::kFloat64).flatten().index_select(0, pixels);
    // Dark pixels are not used, yet their logarithm must stay finite.
    logs.push_back((gray.clamp_min(kDark) + log_offset).log());
    good.push_back((gray > kDark) & (gray < kBright));
  }
  const torch::Tensor all = torch::stack(sums).permute({2, 3, 0, 1});  // [2,P,V,K]
  Series series{all[0].contiguous(), all[1].contiguous(), torch::stack(logs, 1).diff(), {}};
  std::vector<torch::Tensor> usable;
  for (size_t i = 0; i + 1 < exposures.size(); ++i) {
    usable.push_back(good[i] & good[i + 1] & is_neighbour(exposures[i], exposures[i + 1]));
  }
  series.usable = torch::stack(usable, 1);
  return series;
}

/// The model at each pixel's own thresholds, linear about them: the change is
/// X θ + (change − model), all of [P,V−1].
struct Linear {
  torch::Tensor by_threshold;  ///< X, [P,V−1,2]
  torch::Tensor target;        ///< what X θ should be
};

Linear linearise(const Series& series, const torch::Tensor& thresholds) {
  torch::Tensor rule = torch::full({kMoments}, 1.0 / double(kMoments - 1), torch::kFloat64);
  rule[0] *= 0.5, rule[kMoments - 1] *= 0.5;
  const torch::Tensor positive = thresholds.select(1, 0).reshape({-1, 1, 1});
  const torch::Tensor negative = thresholds.select(1, 1).reshape({-1, 1, 1});
  const torch::Tensor j = positive * series.positive - negative * series.negative + rule.log();
  const torch::Tensor weight = torch::softmax(j, 2);
  const torch::Tensor model = torch::logsumexp(j, 2).diff();
  const torch::Tensor x = torch::stack(
      {(weight * series.positive).sum(2).diff(), -(weight * series.negative).sum(2).diff()}, 2);
  return {x, series.change - model + (x * thresholds.unsqueeze(1)).sum(2)};
}

/// The mixed model: θ of a pixel ~ N(mean, spread²), target ~ N(X θ, noise²).
struct Mixed {
  torch::Tensor mean = torch::full({2}, 0.25, torch::kFloat64);
  torch::Tensor variance = torch::full({2}, 0.03 * 0.03, torch::kFloat64);
  double noise = 0.1;
  torch::Tensor thresholds;  ///< [P,2], the mean where a pixel says nothing
  int64_t pixels = 0;
  double unexplained = 1;
};

/// One round: the mean by generalised least squares, each pixel's expected thresholds, and from
/// their scatter and the residuals the variances.
/// @return false if too few pixels speak.
bool improve(const Series& series, Mixed& model) {
  const Linear linear = linearise(series, model.thresholds);
  const torch::Tensor& x = linear.by_threshold;
  const torch::Tensor here = linear.target - (x * model.thresholds.unsqueeze(1)).sum(2);
  const torch::Tensor active = series.usable & (x.abs().sum(2) >= 0.5);
  const torch::Tensor index = (active.sum(1) >= 2).nonzero().flatten();
  model.pixels = index.numel();
  if (model.pixels < 100) return false;
  const torch::Tensor weight =
      active * (kHuber * model.noise / here.abs().clamp_min(1e-9)).clamp_max(1);
  const torch::Tensor weighted = x * (weight / (model.noise * model.noise)).unsqueeze(2);
  const torch::Tensor gram = weighted.transpose(1, 2).matmul(x).index_select(0, index);
  const torch::Tensor seen = weighted.transpose(1, 2)
                                 .matmul(linear.target.unsqueeze(2))
                                 .index_select(0, index);  // [p,2,1]
  // Of events of one polarity, the other threshold has no equation.
  if (gram.sum(0).diagonal().min().item<double>() <= 0) return false;
  const torch::Tensor precision = torch::diag(1 / model.variance);
  const torch::Tensor covariance = torch::linalg_inv(gram + precision);
  // Xᵀ V⁻¹ X and Xᵀ V⁻¹ y of V = noise² + X spread² Xᵀ, without forming V.
  const torch::Tensor left = (precision - precision.matmul(covariance).matmul(precision)).sum(0);
  const torch::Tensor right = precision.matmul(covariance).matmul(seen).sum(0);
  model.mean = torch::linalg_solve(left, right).flatten().clamp(kSmallest, kLargest);
  const torch::Tensor own =
      covariance.matmul(seen + precision.matmul(model.mean.unsqueeze(1))).squeeze(2);
  model.variance = ((own - model.mean).square() + covariance.diagonal(0, 1, 2))
                       .mean(0)
                       .clamp(1e-5, kLargest * kLargest);
  model.thresholds = model.mean.repeat({x.size(0), 1});
  model.thresholds.index_copy_(0, index, own.clamp(kSmallest, kLargest));
  const torch::Tensor residual =
      (linear.target - (x * model.thresholds.unsqueeze(1)).sum(2)).index_select(0, index);
  const torch::Tensor counts = active.index_select(0, index);
  const torch::Tensor left_over = residual.masked_select(counts);
  // A tenth for what the pixels' own thresholds take with them.
  model.noise = std::sqrt(1.1) * left_over.abs().median().item<double>() / 0.6745 + 1e-3;
  const torch::Tensor change = series.change.index_select(0, index).masked_select(counts);
  model.unexplained =
      (left_over.square().sum() / change.square().sum().clamp_min(1e-12)).item<double>();
  return true;
}

}  // namespace

ThresholdEstimate estimate_thresholds(const std::vector<Exposure>& exposures,
                                      const events::EventStream& events, double log_offset) {
  const torch::NoGradGuard no_grad;
  ThresholdEstimate estimate;
  const std::vector<Exposure> some = middle_of(exposures);
  // Two thresholds and one equation per pair of frames.
  if (events.empty() || some.size() < 4) return estimate;
  // Each event belongs to one pixel; shared between the four around a rectified place, counts lose
  // their extremes and thresholds come out a sixth too high.
  const events::EventStream near = events.slice(some.front().t_start_us, some.back().t_end_us);
  const events::EventStream whole(near.x().round(), near.y().round(), near.t_us(), near.polarity());
  const Series series = series_of(some, whole, log_offset);
  Mixed model;
  model.thresholds = model.mean.repeat({series.change.size(0), 1});
  for (int round = 0; round < kRounds; ++round) {
    throw_if_interrupted();
    if (!improve(series, model)) return estimate;
  }
  const auto mean = model.mean.accessor<double, 1>();
  const torch::Tensor deviation = model.variance.sqrt();
  const auto spread = deviation.accessor<double, 1>();
  estimate.thresholds = {mean[0], mean[1]};
  estimate.spread = {spread[0], spread[1]};
  estimate.pixels = model.pixels;
  estimate.residual = model.noise;
  estimate.unexplained = model.unexplained;
  estimate.found =
      model.unexplained < 0.6 && spread[0] < 0.6 * mean[0] && spread[1] < 0.6 * mean[1];
  return estimate;
}

}  // namespace jade::data
