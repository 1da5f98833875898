// SPDX-License-Identifier: Apache-2.0
// Detects from its frames and events whether a recording is gray or in colour.
#pragma once

#include <array>
#include <vector>

#include "jade/core/words.h"
#include "jade/data/exposure.h"

namespace jade::import {

/// A filter of 2 x 2 pixels, named by its rows.
enum class ColorFilter { kNone, kRggb, kBggr, kGrbg, kGbrg };

constexpr auto words_of(ColorFilter) {
  return std::array{Word{"none", ColorFilter::kNone}, Word{"rggb", ColorFilter::kRggb},
                    Word{"bggr", ColorFilter::kBggr}, Word{"grbg", ColorFilter::kGrbg},
                    Word{"gbrg", ColorFilter::kGbrg}};
}

/// Channel (0 red, 1 green, 2 blue) that a filter passes at a pixel.
/// @throws ContractError for none.
int64_t channel_of(ColorFilter filter, int64_t row, int64_t column);

/// Row and column of a filter's first red pixel; from there on the filter is RGGB.
/// @throws ContractError for none.
std::array<int64_t, 2> first_red(ColorFilter filter);

/// Colour filter of the event pixels, estimated from the events.
struct FilterFinding {
  ColorFilter filter = ColorFilter::kNone;
  /// Correlation of event sums with the change of the frames: for gray, and for the best filter.
  double gray_correlation = 0, filter_correlation = 0;
};

/// Finds the colour filter on the event pixels of a recording with frames in colour: behind a
/// filter, a pixel's events correlate with the channel that it passes. Reports a filter only if it
/// leaves 5 % less of the changes unexplained than gray. Gray frames are inconclusive: kNone.
/// @param exposures  frames and times, in order; poses are not used
/// @param events     in coordinates of the raw sensor, by the same clock
FilterFinding find_event_filter(const std::vector<data::Exposure>& exposures,
                                const events::EventStream& events);

}  // namespace jade::import
