// SPDX-License-Identifier: Apache-2.0
// A textured plane in front of a frame sensor and an event sensor, moved along any path: the true
// values for tests of the import.
#pragma once

#include <cmath>
#include <functional>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/simulate/esim.h"
#include "jade/world/noise.h"

namespace jade::test {

struct PatternMotion {
  int64_t width = 64, height = 48;
  int64_t exposures = 8, exposure_us = 30000, gap_us = 20000;
  int64_t step_us = 500;
  std::function<double(double)> x_px, y_px;  ///< place at a time in seconds
};

struct PatternRecording {
  std::vector<data::Exposure> exposures;
  events::EventStream events;
};

/// Each pixel's brightness, in (0.1, 0.9).
inline double pattern_at(double x, double y) {
  return 0.1 + 0.5 * world::value_noise(float(x / 6 + 40), float(y / 6 + 40), 7) +
         0.3 * world::value_noise(float(x / 2.5 + 90), float(y / 2.5 + 90), 8);
}

/// The first exposure starts a gap after the sensors do.
inline PatternRecording record_pattern(const PatternMotion& motion,
                                       const simulate::EventSensorOptions& sensor) {
  PatternRecording recording;
  simulate::EventSensor events(sensor, motion.width, motion.height, 11);
  const int64_t period = motion.exposure_us + motion.gap_us;
  const int64_t end_us = motion.gap_us + motion.exposures * period;
  std::vector<float> now(size_t(motion.width * motion.height));
  torch::Tensor sum = torch::zeros({motion.height, motion.width}, torch::kFloat32);
  int64_t summed = 0;
  for (int64_t t = 0; t <= end_us; t += motion.step_us) {
    const double dx = motion.x_px(1e-6 * double(t)), dy = motion.y_px(1e-6 * double(t));
    for (int64_t i = 0; i < motion.width * motion.height; ++i) {
      now[size_t(i)] =
          float(pattern_at(double(i % motion.width) - dx, double(i / motion.width) - dy));
    }
    events.feed(now, t);
    const int64_t phase = (t - motion.gap_us) % period;
    if (t < motion.gap_us || phase > motion.exposure_us || t >= end_us) continue;
    sum += torch::from_blob(now.data(), {motion.height, motion.width}, torch::kFloat32);
    ++summed;
    if (phase != motion.exposure_us) continue;
    data::Exposure exposure;
    exposure.blurry = (sum / double(summed)).expand({3, -1, -1}).contiguous();
    exposure.t_end_us = t, exposure.t_start_us = t - motion.exposure_us;
    recording.exposures.push_back(std::move(exposure));
    sum = torch::zeros_like(sum), summed = 0;
  }
  recording.events = events.take();
  return recording;
}

}  // namespace jade::test
