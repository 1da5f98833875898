// SPDX-License-Identifier: Apache-2.0
#include "jade/data/threshold_estimate.h"

#include <algorithm>
#include <torch/types.h>

#include "jade/data/event_consistency.h"

namespace jade::data {
namespace {

constexpr size_t kMostExposures = 25;
constexpr size_t kFewestExposures = 4;  // two unknown thresholds, one equation per pair of frames
/// Above these shares, frames and events do not belong together.
constexpr double kMostUnexplained = 0.6, kMostSpread = 0.6, kMostError = 0.2;

/// Consecutive exposures from the middle of the recording, where cameras move most.
std::vector<Exposure> middle_of(const std::vector<Exposure>& exposures) {
  const size_t count = std::min(exposures.size(), kMostExposures);
  const auto begin = exposures.begin() + std::ptrdiff_t((exposures.size() - count) / 2);
  return {begin, begin + std::ptrdiff_t(count)};
}

/// Over long gaps, noise events dominate. Exposures whose times were rounded may overlap a little.
bool is_neighbour(const Exposure& a, const Exposure& b) {
  const int64_t gap = b.t_start_us - a.t_end_us;
  return gap >= -a.duration_us() / 20 && gap <= std::max<int64_t>(3 * a.duration_us(), 100000);
}

/// The estimate for the events as they are.
ThresholdEstimate fitted(const std::vector<Exposure>& exposures, const events::EventStream& events,
                         double log_offset) {
  ThresholdEstimate estimate;
  const std::vector<Exposure> some = middle_of(exposures);
  if (events.empty() || some.size() < kFewestExposures) return estimate;
  std::vector<torch::Tensor> frames;
  std::vector<events::TimeWindow> windows;
  std::vector<bool> neighbours;
  for (size_t i = 0; i < some.size(); ++i) {
    frames.push_back(some[i].blurry);
    windows.push_back({some[i].t_start_us, some[i].t_end_us});
    if (i > 0) neighbours.push_back(is_neighbour(some[i - 1], some[i]));
  }
  ConsistencyOptions options;
  options.log_offset = log_offset;
  const EventConsistency consistency(frames, neighbours, events,
                                     {windows.front().begin_us, windows.back().end_us}, options);
  const ConsistencyFit fit = consistency.fit(windows);
  if (!fit.solved) return estimate;
  estimate.thresholds = fit.thresholds;
  estimate.spread = fit.spread;
  estimate.standard_error = fit.standard_error;
  estimate.pixels = fit.pixels;
  estimate.residual = fit.noise;
  estimate.frame_noise = fit.frame_noise;
  estimate.unexplained = fit.unexplained;
  const auto clear = [&](double threshold, double spread, double error) {
    return spread < kMostSpread * threshold && error < kMostError * threshold;
  };
  estimate.found =
      fit.unexplained < kMostUnexplained &&
      clear(fit.thresholds.positive, fit.spread.positive, fit.standard_error.positive) &&
      clear(fit.thresholds.negative, fit.spread.negative, fit.standard_error.negative);
  return estimate;
}

}  // namespace

ThresholdEstimate estimate_thresholds(const std::vector<Exposure>& exposures,
                                      const events::EventStream& events, double log_offset) {
  const torch::NoGradGuard no_grad;
  ThresholdEstimate estimate = fitted(exposures, events, log_offset);
  if (estimate.found || events.empty() || exposures.empty()) return estimate;
  const events::ImageSize size{exposures[0].blurry.size(-2), exposures[0].blurry.size(-1)};
  double least = 1;
  for (const EventFlip& flip : event_flips(size)) {
    const ThresholdEstimate other = fitted(exposures, flip.undone(events, size), log_offset);
    if (!other.found || other.unexplained >= least) continue;
    estimate.flip = flip, least = other.unexplained;
  }
  return estimate;
}

}  // namespace jade::data
