// SPDX-License-Identifier: Apache-2.0
#include "jade/import/mirroring.h"

#include <algorithm>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/import/clock_offset.h"

namespace jade::import {
namespace {

/// With this correlation events are not mirrored; this saves one estimate per mirror.
constexpr double kAsTheyShould = 0.5;
constexpr double kLeastMirrored = 0.25, kClearlyBetter = 2;

struct Mirror {
  bool x, y;
  const char* name;
};
constexpr Mirror kMirrors[] = {{false, true, "upside down"},
                               {true, false, "mirrored left to right"},
                               {true, true, "turned by 180 degrees"}};

std::string rounded(double correlation) { return std::to_string(correlation).substr(0, 4); }

}  // namespace

std::string find_mirroring(const std::vector<data::Exposure>& exposures,
                           const events::EventStream& events, double correlation) {
  if (correlation >= kAsTheyShould || exposures.empty() || events.empty()) return "";
  const int64_t right = exposures[0].blurry.size(-1) - 1, bottom = exposures[0].blurry.size(-2) - 1;
  const Mirror* best = nullptr;
  double highest = std::max(kLeastMirrored, kClearlyBetter * correlation);
  for (const Mirror& mirror : kMirrors) {
    const ClockOffset found =
        estimate_clock_offset(exposures, {mirror.x ? double(right) - events.x() : events.x(),
                                          mirror.y ? double(bottom) - events.y() : events.y(),
                                          events.t_us(), events.polarity()});
    if (found.ambiguous() || found.correlation <= highest) continue;
    best = &mirror, highest = found.correlation;
  }
  if (best == nullptr) return "";
  return concat("events lie ", best->name, " against the frames: correlation ",
                rounded(std::max(correlation, 0.0)), " as they are, ", rounded(highest),
                " otherwise; replace ", best->x ? concat("x by ", right, " - x") : "",
                best->x && best->y ? " and " : "", best->y ? concat("y by ", bottom, " - y") : "");
}

}  // namespace jade::import
