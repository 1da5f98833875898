// SPDX-License-Identifier: Apache-2.0
// Footage in closed form, for tests that simulate a recording quickly.
#pragma once

#include <algorithm>
#include <cmath>

#include "jade/simulate/footage.h"
#include "jade/world/noise.h"

namespace jade::test {

/// A pattern of one tint that drifts to the left at constant speed, so that all channels share
/// every change of log intensity, in front of a camera that moves on a line and rotates about the
/// vertical.
class DriftingPattern : public simulate::Footage {
 public:
  /// @param step_us  from one frame to the next
  DriftingPattern(int64_t width, int64_t height, double px_per_s, int64_t step_us)
      : camera_(geometry::Intrinsics::centred(100, width, height)),
        px_per_s_(px_per_s),
        step_us_(step_us) {}

  const geometry::Intrinsics& camera() const override { return camera_; }

  geometry::Pose pose(double t_us) const override {
    const double t = 1e-6 * t_us;
    return geometry::pose_at_centre(geometry::rotation_from_vector({0, 0.1 * t, 0}),
                                    {0.5 * t, -0.2 * t, 0.1});
  }

  void frame(int64_t t_us, int /*samples*/, world::SharpFrame& frame) const override {
    constexpr float kTint[] = {1.0f, 0.8f, 0.6f};
    frame.resize(camera_.width, camera_.height);
    std::fill(frame.depth.begin(), frame.depth.end(), 2.0f);
    const double shift = px_per_s_ * 1e-6 * static_cast<double>(t_us);
    const auto pixels = static_cast<size_t>(camera_.width * camera_.height);
    for (size_t i = 0; i < pixels; ++i) {
      const auto x = static_cast<double>(i % static_cast<size_t>(camera_.width));
      const auto y = static_cast<float>(i / static_cast<size_t>(camera_.width));
      const float noise =
          world::value_noise(static_cast<float>((x + shift) / kCell_px), y / kCell_px, 7);
      for (size_t c = 0; c < 3; ++c) {
        frame.rgb[c * pixels + i] = kTint[c] * (kDarkest + (kBrightest - kDarkest) * noise);
      }
    }
  }

  int64_t next_us(const world::SharpFrame& /*frame*/, int64_t now_us, int64_t until_us) override {
    return std::min(until_us, now_us + step_us_);
  }

  Depths depths(const simulate::Timeline& /*timeline*/) const override { return {1, 10}; }

 private:
  static constexpr float kCell_px = 3, kDarkest = 0.35f, kBrightest = 0.85f;

  const geometry::Intrinsics camera_;
  const double px_per_s_;
  const int64_t step_us_;
};

}  // namespace jade::test
