// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/moving_object.h"

#include "support/catch.h"

#include <algorithm>
#include <cmath>

using namespace jade;
using namespace jade::simulate;

namespace {

const auto kBallCamera = geometry::Intrinsics::centred(200, 120, 90);

ObjectOptions swinging_ball() {
  ObjectOptions options;
  options.radius_px = 12, options.travel_px = 30, options.period_ms = 400;
  return options;
}

/// Pixels of the ball on black.
struct Spot {
  int64_t pixels = 0;
  double x = 0;
};
Spot spot_seen(const MovingObject& object, double t_us, float wall_depth = 5,
               const geometry::Pose& pose = {}) {
  world::SharpFrame frame;
  frame.resize(kBallCamera.width, kBallCamera.height);
  std::fill(frame.rgb.begin(), frame.rgb.end(), 0.0f);
  std::fill(frame.depth.begin(), frame.depth.end(), wall_depth);
  object.draw(kBallCamera, pose, t_us, frame);
  Spot spot;
  for (int64_t i = 0; i < kBallCamera.width * kBallCamera.height; ++i) {
    if (frame.rgb[static_cast<size_t>(i)] == 0) continue;
    ++spot.pixels, spot.x += static_cast<double>(i % kBallCamera.width) + 0.5;
  }
  if (spot.pixels > 0) spot.x /= static_cast<double>(spot.pixels);
  return spot;
}

}  // namespace

TEST_CASE("moving object: has the size asked for and swings as far", "[simulate]") {
  const MovingObject object(swinging_ball(), kBallCamera, {}, 2);
  CHECK(object.is_there());
  CHECK_FALSE(MovingObject({}, kBallCamera, {}, 2).is_there());
  const double area = 3.14159 * 12 * 12;
  CHECK(static_cast<double>(spot_seen(object, 0).pixels) == Approx(area).epsilon(0.15));
  CHECK(spot_seen(object, 0).x == Approx(60).margin(0.5));
  CHECK(spot_seen(object, 100000).x == Approx(90).margin(1));
  CHECK(spot_seen(object, 300000).x == Approx(30).margin(1));
  CHECK(spot_seen(object, 400000).x == Approx(60).margin(0.5));
}

TEST_CASE("moving object: stands in the world, before what is further away", "[simulate]") {
  const MovingObject object(swinging_ball(), kBallCamera, {}, 2);
  CHECK(spot_seen(object, 0, 1.5f).pixels == 0);
  // A camera farther to the right sees it farther to the left.
  const auto right = geometry::pose_at_centre(geometry::Pose{}.rotation, {0.1, 0, 0});
  CHECK(spot_seen(object, 0, 5, right).x == Approx(50).margin(0.5));
}

TEST_CASE("moving object: moves no further than asked for in the time that it says", "[simulate]") {
  const MovingObject object(swinging_ball(), kBallCamera, {}, 2);
  const double step_us = object.time_for_us(3);
  double furthest = 0;
  for (double t = 0; t < 4e5; t += step_us) {
    furthest =
        std::max(furthest, std::abs(spot_seen(object, t + step_us).x - spot_seen(object, t).x));
  }
  CHECK((furthest > 1.5 && furthest < 3.3));
}
