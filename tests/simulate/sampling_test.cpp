// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/sampling.h"

#include "support/catch.h"

#include <algorithm>
#include <cmath>

#include "jade/world/builder.h"
#include "jade/world/ray_caster.h"

using namespace jade;
using namespace jade::simulate;

namespace {

world::RayCaster wall() {
  world::WorldBuilder s("wall", 1);
  s.quad({-5, 5, 0}, {10, 0, 0}, {0, -10, 0}, s.plain({0.5f, 0.5f, 0.5f}));
  s.ball({0.1f, 1, 0.9f}, 0.2f, s.plain({0.9f, 0.2f, 0.2f}));
  s.world().rig = {{0, 1, 2.5f}, {0, 1, 0}, {0.4f, 0.2f, 0.2f}, {0.3f, 0.2f, 0}};
  return world::RayCaster(s.finish());
}

const auto kCamera = geometry::Intrinsics::centred(100, 80, 60);

}  // namespace

TEST_CASE("timeline: exposures follow each other, test views lie in them and between",
          "[simulate]") {
  SimulateOptions options;
  options.exposures = 7, options.exposure_ms = 30, options.gap_ms = 4;
  options.test_views = 5, options.seen_test_views = 2;
  const Timeline timeline = make_timeline(options);
  REQUIRE(timeline.exposures.size() == 7);
  REQUIRE(timeline.tests_us.size() == 5);
  for (size_t i = 0; i < 7; ++i) {
    CHECK(timeline.exposures[i].end_us - timeline.exposures[i].begin_us == 30000);
    if (i > 0) CHECK(timeline.exposures[i].begin_us - timeline.exposures[i - 1].end_us == 4000);
  }
  for (size_t k = 0; k < 5; ++k) {
    int inside = 0, middle = 0;
    for (const auto& w : timeline.exposures) {
      inside += timeline.tests_us[k] >= w.begin_us && timeline.tests_us[k] < w.end_us;
      middle += timeline.tests_us[k] == w.mid_us();
    }
    CHECK(inside == (k < 2));
    CHECK(middle == (k < 2));
  }
  CHECK(timeline.end_us > timeline.exposures.back().end_us);
}

TEST_CASE("timeline: more test views than gaps share them, each at a time of its own",
          "[simulate]") {
  SimulateOptions options;
  options.exposures = 3, options.exposure_ms = 30, options.gap_ms = 6;
  options.test_views = 6, options.seen_test_views = 1;
  const Timeline timeline = make_timeline(options);
  REQUIRE(timeline.tests_us.size() == 6);
  for (size_t k = 2; k < 6; ++k) CHECK(timeline.tests_us[k] > timeline.tests_us[k - 1]);
  for (size_t k = 1; k < 6; ++k) {
    for (const auto& w : timeline.exposures) {
      CHECK((timeline.tests_us[k] < w.begin_us || timeline.tests_us[k] > w.end_us));
    }
  }
}

TEST_CASE("camera path: moves smoothly and by the blur asked for", "[simulate]") {
  const world::RayCaster source = wall();
  CameraPath path(source.world().rig, 1, 9);
  SimulateOptions options;
  options.exposures = 6, options.exposure_ms = 40;
  const Timeline timeline = make_timeline(options);
  const double blur = set_speed_for_blur(path, source, kCamera, timeline, 6);
  CHECK(blur == Approx(6).epsilon(0.03));
  // Second differences of the centre decrease with the square of the step: no corners.
  const auto x = [&](double t) { return geometry::centre(path.at(t))[0]; };
  for (double t = 1e4; t < 2e5; t += 7e3) {
    const double coarse = std::abs(x(t + 2000) - 2 * x(t) + x(t - 2000));
    const double fine = std::abs(x(t + 1000) - 2 * x(t) + x(t - 1000));
    CHECK(fine <= 0.3 * coarse + 1e-9);
  }
}

TEST_CASE("camera path: rests for a part of each period and comes as far", "[simulate]") {
  const world::RayCaster source = wall();
  CameraPath steady(source.world().rig, 1, 9), resting = steady;
  resting.set_rest(0.6, 200000);
  const auto centre = [](const CameraPath& path, double t_us) {
    return geometry::centre(path.at(t_us));
  };
  for (double period = 0; period < 1e6; period += 2e5) {
    CHECK(centre(resting, period) == centre(steady, period));
    CHECK(centre(resting, period + 1.19e5) == centre(resting, period));
    CHECK(centre(resting, period + 1.6e5)[0] ==
          Approx(centre(steady, period + 1e5)[0]).margin(1e-9));
  }
  // No corner at starts and stops: the speed is near zero there.
  const auto step = [&](double t) {
    return std::abs(centre(resting, t + 500)[0] - centre(resting, t)[0]);
  };
  CHECK(step(1.2e5) < 0.01 * step(1.6e5));
  CHECK(step(1.995e5) < 0.01 * step(1.6e5));
}

TEST_CASE("blur: a sideways move smears by focal length times way over depth", "[simulate]") {
  world::SharpFrame frame;
  frame.resize(8, 6);
  std::fill(frame.depth.begin(), frame.depth.end(), 2.0f);
  const geometry::Pose from, to{from.rotation, {0.03, 0, 0}};
  CHECK(largest_flow(frame, geometry::Intrinsics::centred(100, 8, 6), from, to) == Approx(1.5));
}

TEST_CASE("frame clock: no pixel moves further than the bound, and steps are not wasted",
          "[simulate]") {
  const world::RayCaster source = wall();
  CameraPath path(source.world().rig, 1, 9);
  SimulateOptions options;
  options.exposures = 4, options.exposure_ms = 40;
  set_speed_for_blur(path, source, kCamera, make_timeline(options), 10);
  SamplingOptions sampling;
  sampling.max_flow_px = 0.5;
  FrameClock clock(sampling, path, kCamera);
  int64_t now = 0;
  int frames = 0;
  double sum = 0;
  while (now < 60000) {
    world::SharpFrame frame;
    source.render(path.at(static_cast<double>(now)), kCamera, 1, frame);
    const int64_t next = clock.next_us(frame, now, 60000);
    REQUIRE(next > now);
    const double flow = largest_flow(frame, kCamera, path.at(static_cast<double>(now)),
                                     path.at(static_cast<double>(next)));
    CHECK(flow <= 0.5);
    sum += flow, now = next, ++frames;
  }
  CHECK(now == 60000);
  CHECK(sum / frames > 0.3);
  sampling.min_fps = 5000;
  FrameClock fast(sampling, path, kCamera);
  world::SharpFrame frame;
  source.render(path.at(0), kCamera, 1, frame);
  CHECK(fast.next_us(frame, 0, 60000) <= 200);
}
