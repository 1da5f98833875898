// SPDX-License-Identifier: Apache-2.0
#include "jade/import/color.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>

#include "jade/core/check.h"
#include "jade/imaging/color.h"
#include "jade/import/frame_change.h"

namespace jade::import {
namespace {

constexpr double kLeastGain = 0.05;
constexpr size_t kMostPairs = 12;
constexpr double kFrameFloor = 0.02;

/// Sums for one place of the cell and one channel (the fourth is gray).
struct Sums {
  double cross = 0, frame = 0, event = 0;
};
using Table = std::array<std::array<Sums, 4>, 4>;  ///< by place, row first, and channel

void add_pair(const data::Exposure& a, const data::Exposure& b, const events::EventStream& events,
              Table& table) {
  const torch::Tensor sums = event_change(a, b, events);
  const auto with_gray = [](const torch::Tensor& frame) {
    return torch::cat({frame, imaging::gray(frame)});
  };
  const torch::Tensor before = with_gray(a.blurry), after = with_gray(b.blurry);
  const torch::Tensor low = torch::minimum(before, after).amin(0);
  const torch::Tensor high = torch::maximum(before, after).amax(0);
  const torch::Tensor usable = (low > 0.03) & (high < 0.97);
  const torch::Tensor change = (after + kFrameFloor).log() - (before + kFrameFloor).log();
  for (int64_t place = 0; place < 4; ++place) {
    const auto cells = [&](const torch::Tensor& image) {
      return image.slice(-2, place / 2, {}, 2).slice(-1, place % 2, {}, 2);
    };
    const torch::Tensor mask = cells(usable);
    const torch::Tensor e = cells(sums).masked_select(mask).to(torch::kFloat64);
    if (e.numel() == 0) continue;
    for (int64_t channel = 0; channel < 4; ++channel) {
      const torch::Tensor d = cells(change[channel]).masked_select(mask).to(torch::kFloat64);
      Sums& entry = table[size_t(place)][size_t(channel)];
      entry.cross += (e * d).sum().item<double>();
      entry.frame += d.square().sum().item<double>();
      entry.event += e.square().sum().item<double>();
    }
  }
}

double correlation(const Table& table, ColorFilter filter) {
  Sums all;
  for (int64_t place = 0; place < 4; ++place) {
    const int64_t channel =
        filter == ColorFilter::kNone ? 3 : channel_of(filter, place / 2, place % 2);
    const Sums& entry = table[size_t(place)][size_t(channel)];
    all.cross += entry.cross, all.frame += entry.frame, all.event += entry.event;
  }
  const double scale = std::sqrt(all.frame * all.event);
  return scale > 0 ? all.cross / scale : 0;
}

}  // namespace

int64_t channel_of(ColorFilter filter, int64_t row, int64_t column) {
  JADE_CHECK(filter != ColorFilter::kNone, "channel_of: expected a filter, found none");
  const bool red_row_first = filter == ColorFilter::kRggb || filter == ColorFilter::kGrbg;
  const bool green_first = filter == ColorFilter::kGrbg || filter == ColorFilter::kGbrg;
  const bool red_row = (row % 2 == 0) == red_row_first;
  const bool green = (row % 2 == column % 2) == green_first;
  if (green) return 1;
  return red_row ? 0 : 2;
}

std::array<int64_t, 2> first_red(ColorFilter filter) {
  for (int64_t place = 0; place < 4; ++place) {
    if (channel_of(filter, place / 2, place % 2) == 0) return {place / 2, place % 2};
  }
  throw ContractError("expected a filter with red pixels");
}

FilterFinding find_event_filter(const std::vector<data::Exposure>& exposures,
                                const events::EventStream& events) {
  const torch::NoGradGuard no_grad;
  FilterFinding finding;
  Table table{};
  const size_t pairs = exposures.empty() ? 0 : exposures.size() - 1;
  const size_t step = std::max<size_t>(1, pairs / kMostPairs);
  for (size_t i = 0; i < pairs; i += step) {
    if (imaging::is_gray(exposures[i].blurry)) return finding;
    add_pair(exposures[i], exposures[i + 1], events, table);
  }
  finding.gray_correlation = correlation(table, ColorFilter::kNone);
  ColorFilter best = ColorFilter::kNone;
  for (const auto filter :
       {ColorFilter::kRggb, ColorFilter::kBggr, ColorFilter::kGrbg, ColorFilter::kGbrg}) {
    const double value = correlation(table, filter);
    if (best == ColorFilter::kNone || value > finding.filter_correlation) {
      finding.filter_correlation = value, best = filter;
    }
  }
  const double gray_left = 1 - finding.gray_correlation * finding.gray_correlation;
  const double filter_left = 1 - finding.filter_correlation * finding.filter_correlation;
  if (finding.filter_correlation > 0.2 && filter_left < (1 - kLeastGain) * gray_left) {
    finding.filter = best;
  }
  return finding;
}

}  // namespace jade::import
