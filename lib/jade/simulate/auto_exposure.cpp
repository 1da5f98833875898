// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/auto_exposure.h"

#include <algorithm>
#include <cmath>

namespace jade::simulate {
namespace {

constexpr double kMeterRange = 8;  // factor by which lengths decrease and gains increase

/// Mean light of the middle third, of all channels.
double metered(const world::SharpFrame& frame, Encoding encoding) {
  double sum = 0;
  int64_t count = 0;
  for (int c = 0; c < 3; ++c) {
    for (int64_t y = frame.height / 3; y < frame.height - frame.height / 3; ++y) {
      for (int64_t x = frame.width / 3; x < frame.width - frame.width / 3; ++x, ++count) {
        sum += decode(frame.channel(c)[y * frame.width + x], encoding);
      }
    }
  }
  return sum / static_cast<double>(count);
}

}  // namespace

std::vector<ExposureSetting> exposure_settings(const SimulateOptions& o, const Footage& footage,
                                               const Timeline& timeline) {
  std::vector<ExposureSetting> settings(timeline.exposures.size());
  if (o.image.auto_exposure <= 0) return settings;
  world::SharpFrame frame;
  for (size_t i = 0; i < settings.size(); ++i) {
    const size_t seen = i == 0 ? 0 : i - 1;
    footage.frame(timeline.exposures[seen].mid_us(), /*samples=*/1, frame);
    const double light = metered(frame, o.image.encoding) * o.light.brightness;
    const double wanted = o.image.auto_exposure / std::max(light, 1e-6);
    settings[i].time = std::clamp(wanted, 1 / kMeterRange, 1.0);
    settings[i].gain = std::clamp(wanted / settings[i].time, 1.0, kMeterRange);
  }
  return settings;
}

void shorten(const std::vector<ExposureSetting>& settings, Timeline& timeline) {
  for (size_t i = 0; i < settings.size(); ++i) {
    if (settings[i].time == 1) continue;
    auto& window = timeline.exposures[i];
    const int64_t middle = window.mid_us();
    const auto half =
        std::max<int64_t>(1, std::llround(0.5 * settings[i].time *
                                          static_cast<double>(window.end_us - window.begin_us)));
    window = {middle - half, middle + half};
  }
}

}  // namespace jade::simulate
