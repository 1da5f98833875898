// SPDX-License-Identifier: Apache-2.0
#include "jade/import/flipped_events.h"

#include <algorithm>
#include <optional>

#include "jade/core/error.h"
#include "jade/data/event_flip.h"
#include "jade/import/clock_offset.h"

namespace jade::import {
namespace {

/// Events with this correlation agree with the frames; for others each flip is tried.
constexpr double kAgrees = 0.5;
constexpr double kLeastFlipped = 0.25, kClearlyBetter = 2;

std::string rounded(double correlation) { return std::to_string(correlation).substr(0, 4); }

}  // namespace

std::string find_flip(const std::vector<data::Exposure>& exposures,
                      const events::EventStream& events, double correlation) {
  if (correlation >= kAgrees || exposures.empty() || events.empty()) return "";
  const events::ImageSize size{exposures[0].blurry.size(-2), exposures[0].blurry.size(-1)};
  std::optional<data::EventFlip> best;
  double highest = std::max(kLeastFlipped, kClearlyBetter * correlation);
  for (const data::EventFlip& flip : data::event_flips(size)) {
    const ClockOffset found = estimate_clock_offset(exposures, flip.undone(events, size));
    if (found.ambiguous() || found.correlation <= highest) continue;
    best = flip, highest = found.correlation;
  }
  if (!best) return "";
  return concat("events ", best->name(), " against the frames: correlation ",
                rounded(std::max(correlation, 0.0)), " as they are, ", rounded(highest),
                " otherwise; ", best->cure(size));
}

}  // namespace jade::import
