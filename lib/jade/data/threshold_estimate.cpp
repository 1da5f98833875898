// SPDX-License-Identifier: Apache-2.0
#include "jade/data/threshold_estimate.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>

#include "jade/events/counts.h"
#include "jade/events/exposure_maps.h"
#include "jade/imaging/color.h"

namespace jade::data {
namespace {

constexpr double kDark = 0.04;
constexpr double kBright = 0.96;
constexpr int kRounds = 12;

/// What one exposure says, flattened to [P] and [8,P] float64.
struct LogView {
  torch::Tensor log_frame;
  torch::Tensor usable;
  torch::Tensor positive, negative;  ///< events in the eight windows
};

/// Events of two neighbours between their mid-exposures.
struct Pair {
  LogView first, second;
  torch::Tensor positive, negative;  ///< [P]
};

LogView view_of(const Exposure& exposure, double log_offset) {
  const events::ImageSize size{exposure.camera.height, exposure.camera.width};
  const torch::Tensor gray = imaging::gray(exposure.blurry).to(torch::kFloat64).flatten();
  const auto maps =
      events::map_exposure(exposure.events, {exposure.t_start_us, exposure.t_end_us}, 6, size);
  // Dark pixels are not used, yet their logarithm must stay finite.
  return {(gray.clamp_min(kDark) + log_offset).log(), (gray > kDark) & (gray < kBright),
          maps.windows.positive.to(torch::kFloat64).flatten(1),
          maps.windows.negative.to(torch::kFloat64).flatten(1)};
}

/// Log of the mean of exp(J_k) over the nine times, and its derivatives to Θ⁺ and Θ⁻.
struct LogBlur {
  torch::Tensor value, by_positive, by_negative;
};

LogBlur log_blur(const LogView& view, const events::Thresholds& thresholds) {
  std::vector<torch::Tensor> positive, negative;
  for (int64_t k = 0; k <= events::kEdiWindows; ++k) {
    const int64_t mid = geometry::kMidPose;
    const double sign = k < mid ? -1 : 1;
    const auto sum = [&](const torch::Tensor& windows) {
      return sign * windows.slice(0, std::min(k, mid), std::max(k, mid)).sum(0);
    };
    positive.push_back(sum(view.positive));
    negative.push_back(-sum(view.negative));
  }
  const torch::Tensor p = torch::stack(positive);
  const torch::Tensor n = torch::stack(negative);
  const torch::Tensor j = thresholds.positive * p + thresholds.negative * n;
  const torch::Tensor weight = torch::softmax(j, 0);
  return {torch::logsumexp(j, 0) - std::log(9.0), (weight * p).sum(0), (weight * n).sum(0)};
}

std::vector<Pair> pairs_of(const Dataset& dataset, double log_offset) {
  std::vector<Pair> pairs;
  for (size_t i = 0; i + 1 < dataset.train.size(); ++i) {
    const Exposure& a = dataset.train[i];
    const Exposure& b = dataset.train[i + 1];
    // Over long gaps, noise events outweigh what the frames can tell.
    if (b.t_start_us < a.t_end_us || a.duration_us() == 0 ||
        b.t_start_us - a.t_end_us > 3 * a.duration_us()) {
      continue;
    }
    const events::ImageSize size{a.camera.height, a.camera.width};
    const torch::Tensor counts =
        events::to_events(events::count_events(dataset.events, {a.t_mid_us(), b.t_mid_us()}, size));
    const torch::Tensor flat = counts[0].to(torch::kFloat64).flatten(1);
    pairs.push_back({view_of(a, log_offset), view_of(b, log_offset), flat[0], flat[1]});
    if (pairs.size() == 24) break;
  }
  return pairs;
}

/// Sums of the weighted normal equations, in their own type to be added up pair by pair.
struct Normal {
  double pp = 0, pn = 0, nn = 0, p = 0, n = 0;
  double squares = 0, change = 0, weight = 0;
};

void add_pair(const Pair& pair, const events::Thresholds& thresholds, double huber, Normal& sum) {
  const LogBlur a = log_blur(pair.first, thresholds);
  const LogBlur b = log_blur(pair.second, thresholds);
  const torch::Tensor change = pair.second.log_frame - pair.first.log_frame;
  const torch::Tensor model =
      thresholds.positive * pair.positive - thresholds.negative * pair.negative + b.value - a.value;
  const torch::Tensor residual = change - model;
  const torch::Tensor by_p = pair.positive + b.by_positive - a.by_positive;
  const torch::Tensor by_n = -pair.negative + b.by_negative - a.by_negative;
  const torch::Tensor use =
      (pair.first.usable & pair.second.usable & ((pair.positive + pair.negative) >= 1))
          .to(torch::kFloat64);
  const torch::Tensor w = use * (huber / residual.abs().clamp_min(huber));
  const auto total = [](const torch::Tensor& value) { return value.sum().item<double>(); };
  sum.pp += total(w * by_p * by_p);
  sum.pn += total(w * by_p * by_n);
  sum.nn += total(w * by_n * by_n);
  sum.p += total(w * by_p * residual);
  sum.n += total(w * by_n * residual);
  sum.squares += total(w * residual * residual);
  sum.change += total(w * change * change);
  sum.weight += total(use);
}

}  // namespace

ThresholdEstimate estimate_thresholds(const Dataset& dataset, double log_offset) {
  const torch::NoGradGuard no_grad;
  ThresholdEstimate estimate;
  if (dataset.events.empty()) return estimate;
  const std::vector<Pair> pairs = pairs_of(dataset, log_offset);
  estimate.thresholds = {0.2, 0.2};
  for (int round = 0; round < kRounds; ++round) {
    Normal sum;
    const double huber = round == 0 ? 10.0 : std::max(0.05, 1.5 * estimate.residual);
    for (const Pair& pair : pairs) add_pair(pair, estimate.thresholds, huber, sum);
    const double determinant = sum.pp * sum.nn - sum.pn * sum.pn;
    estimate.pixels = static_cast<int64_t>(sum.weight);
    if (estimate.pixels < 100 || !(determinant > 1e-9 * sum.pp * sum.nn)) return estimate;
    estimate.residual = std::sqrt(sum.squares / sum.weight);
    estimate.unexplained = sum.squares / sum.change;
    const double step_p = (sum.nn * sum.p - sum.pn * sum.n) / determinant;
    const double step_n = (sum.pp * sum.n - sum.pn * sum.p) / determinant;
    estimate.thresholds.positive = std::clamp(estimate.thresholds.positive + step_p, 0.01, 3.0);
    estimate.thresholds.negative = std::clamp(estimate.thresholds.negative + step_n, 0.01, 3.0);
  }
  estimate.found = estimate.unexplained < 0.9;
  return estimate;
}

}  // namespace jade::data
