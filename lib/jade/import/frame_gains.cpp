// SPDX-License-Identifier: Apache-2.0
#include "jade/import/frame_gains.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>

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

/// Subtracts the best-fitting line.
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

}  // namespace

std::vector<double> estimate_frame_gains(const std::vector<data::Exposure>& exposures,
                                         const events::EventStream& events) {
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
  std::vector<double> at, logs{0}, errors;
  for (size_t i = 0; i < fit.steps.size(); ++i) {
    logs.push_back(logs.back() + fit.steps[i]);
    if (std::isfinite(fit.step_errors[i])) errors.push_back(fit.step_errors[i]);
  }
  if (errors.empty()) return {};
  for (const data::Exposure& exposure : exposures) at.push_back(double(exposure.t_mid_us()));
  for (size_t i = at.size(); i-- > 0;) at[i] -= at.front();
  remove_trend(at, logs);
  std::sort(errors.begin(), errors.end());
  const double error = errors[errors.size() / 2] * std::sqrt(double(errors.size()) / 6);
  const auto [lowest, highest] = std::minmax_element(logs.begin(), logs.end());
  if (*highest - *lowest < std::max(kLeastRange, kClearErrors * error)) return {};
  std::vector<double> gains;
  for (const double log : logs) gains.push_back(std::exp(log));
  return gains;
}

}  // namespace jade::import
