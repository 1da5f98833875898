// SPDX-License-Identifier: Apache-2.0
#include "jade/import/frame_gains.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>

#include "jade/core/median.h"
#include "jade/data/event_consistency.h"

namespace jade::import {
namespace {

constexpr size_t kFewestShots = 4;
// over longer gaps, events do not determine the change of the frames
constexpr int64_t kLongestGap_us = 500000;
/// Maximum number of pixel curves over all compared frames, and minimum of pixels per frame.
constexpr int64_t kMostCurves = 1500000, kFewestPixels = 500, kMostPixels = 3000;
constexpr double kLeastRange = 0.05;  // in log units
constexpr double kClearErrors = 6;    // least range in standard errors of a step
constexpr size_t kMostSlopes = 600;   // frames whose slopes are compared with one another
constexpr double kAlike = 0.25;       // of the step to a single odd frame, between its neighbours

/// Subtracts the line of the median slope (H. Theil, P. K. Sen), which single values do not move.
void remove_median_trend(const std::vector<double>& at, std::vector<double>& values) {
  std::vector<double> slopes;
  const size_t step = 1 + values.size() / kMostSlopes;
  for (size_t i = 0; i < values.size(); i += step) {
    for (size_t k = i + step; k < values.size(); k += step) {
      if (at[k] > at[i]) slopes.push_back((values[k] - values[i]) / (at[k] - at[i]));
    }
  }
  const double slope = slopes.empty() ? 0 : median_of(std::move(slopes));
  for (size_t i = 0; i < values.size(); ++i) values[i] -= slope * at[i];
  const double start = median_of(values);
  for (double& value : values) value -= start;
}

/// Subtracts the best-fitting line, which is closer to the truth where no frame is odd.
void remove_trend(const std::vector<double>& at, std::vector<double>& values) {
  const auto count = double(values.size());
  double st = 0, sv = 0, stt = 0, stv = 0;
  for (size_t i = 0; i < values.size(); ++i) {
    st += at[i], sv += values[i], stt += at[i] * at[i], stv += at[i] * values[i];
  }
  const double spread = count * stt - st * st;
  const double slope = spread > 0 ? (count * stv - st * sv) / spread : 0;
  const double start = (sv - slope * st) / count;
  for (size_t i = 0; i < values.size(); ++i) values[i] -= start + slope * at[i];
}

/// Logarithms of the frames' brightness, without their trend.
struct Levels {
  std::vector<double> logs;  ///< none if they cannot be measured
  double bar = 0;            ///< smaller differences are noise

  bool vary() const {
    if (logs.empty()) return false;
    const auto [lowest, highest] = std::minmax_element(logs.begin(), logs.end());
    return *highest - *lowest >= bar;
  }
};

/// Middles of the exposures after the first one, µs.
std::vector<double> times_of(const std::vector<data::Exposure>& exposures) {
  std::vector<double> at;
  for (const data::Exposure& exposure : exposures) {
    at.push_back(double(exposure.t_mid_us() - exposures.front().t_mid_us()));
  }
  return at;
}

Levels levels_of(const std::vector<data::Exposure>& exposures, const events::EventStream& events) {
  if (exposures.size() < kFewestShots || events.empty()) return {};
  std::vector<torch::Tensor> frames;
  std::vector<events::TimeWindow> windows;
  for (const data::Exposure& exposure : exposures) {
    frames.push_back(exposure.blurry);
    windows.push_back({exposure.t_start_us, exposure.t_end_us});
  }
  data::ConsistencyOptions options;
  options.pixels = std::clamp(kMostCurves / int64_t(frames.size()), kFewestPixels, kMostPixels);
  options.rounds = 4;
  std::vector<bool> neighbours;
  for (size_t i = 1; i < windows.size(); ++i) {
    neighbours.push_back(windows[i].begin_us - windows[i - 1].end_us < kLongestGap_us);
  }
  const data::EventConsistency consistency(
      frames, neighbours, events, {windows.front().begin_us, windows.back().end_us + 1}, options);
  const data::ConsistencyFit fit = consistency.fit(windows);
  if (!fit.solved) return {};
  Levels levels{{0}, 0};
  std::vector<double> errors;
  for (size_t i = 0; i < fit.steps.size(); ++i) {
    levels.logs.push_back(levels.logs.back() + fit.steps[i]);
    if (std::isfinite(fit.step_errors[i])) errors.push_back(fit.step_errors[i]);
  }
  if (errors.empty()) return {};
  remove_median_trend(times_of(exposures), levels.logs);
  const double error = median_of(errors) * std::sqrt(double(errors.size()) / 6);
  levels.bar = std::max(kLeastRange, kClearErrors * error);
  return levels;
}

/// By how much each single frame differs from both frames beside it, which are alike; 0 for others.
std::vector<double> odd_logs(const Levels& levels) {
  const std::vector<double>& logs = levels.logs;
  const size_t count = logs.size();
  std::vector<double> odd(count, 0.0);
  for (size_t i = 0; i < count; ++i) {
    const double a = logs[i == 0 ? 2 : i - 1], b = logs[i + 1 == count ? count - 3 : i + 1];
    const double off = logs[i] - 0.5 * (a + b);
    if (std::abs(off) >= levels.bar && std::abs(a - b) <= kAlike * std::abs(off)) odd[i] = off;
  }
  return odd;
}

}  // namespace

std::vector<double> estimate_frame_gains(const std::vector<data::Exposure>& exposures,
                                         const events::EventStream& events) {
  Levels levels = levels_of(exposures, events);
  if (!levels.vary()) return {};
  const std::vector<double> odd = odd_logs(levels);
  std::vector<data::Exposure> others;
  for (size_t i = 0; i < odd.size(); ++i) {
    if (odd[i] == 0) others.push_back(exposures[i]);
  }
  if (others.size() == odd.size()) remove_trend(times_of(exposures), levels.logs);
  if (others.size() < odd.size() && 2 * others.size() > odd.size()) {
    // The steps to and from an odd frame are uncertain and would shift all frames behind it.
    const Levels rest = levels_of(others, events);
    if (rest.logs.size() == others.size()) {
      const bool vary = rest.vary();
      for (size_t i = 0, next = 0; i < odd.size(); ++i) {
        const double before = next == 0 || !vary ? 0 : rest.logs[next - 1];
        levels.logs[i] = odd[i] != 0 ? before + odd[i] : vary ? rest.logs[next] : 0;
        if (odd[i] == 0) ++next;
      }
    }
  }
  std::vector<double> gains;
  for (const double log : levels.logs) gains.push_back(std::exp(log));
  return gains;
}

}  // namespace jade::import
