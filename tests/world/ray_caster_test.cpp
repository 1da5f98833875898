// SPDX-License-Identifier: Apache-2.0
#include "jade/world/ray_caster.h"

#include "support/catch.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <cmath>

#include "jade/core/error.h"
#include "jade/world/builder.h"
#include "jade/world/worlds.h"

using namespace jade;
using namespace jade::world;

namespace {

/// A bright ball in an otherwise empty, dark world.
RayCaster ball_at(Vec3 place, float radius) {
  WorldBuilder s("ball", 1);
  s.ball(place, radius, s.material(Canvas(4, 4, {1, 1, 1}), 1.0f));
  s.world().background = {0, 0, 0};
  return RayCaster(s.finish());
}

}  // namespace

TEST_CASE("ray caster: a known point appears where its projection says", "[world]") {
  const Vec3 place{0.3f, 0.8f, -0.5f};
  const RayCaster world = ball_at(place, 0.04f);
  const auto camera = geometry::Intrinsics::centred(450, 346, 260);
  for (const geometry::Vector3& eye :
       {geometry::Vector3{0, 1, 2}, geometry::Vector3{-0.4, 1.2, 1.6},
        geometry::Vector3{0.9, 0.5, 2.2}}) {
    const auto pose = geometry::look_at(eye, {0.1, 0.9, 0}, {0.1, 1, 0});
    SharpFrame frame;
    world.render(pose, camera, 16, frame);
    double sum = 0, u = 0, v = 0;
    for (int64_t y = 0; y < frame.height; ++y) {
      for (int64_t x = 0; x < frame.width; ++x) {
        const double value = frame.channel(0)[y * frame.width + x];
        sum += value, u += value * (static_cast<double>(x) + 0.5),
            v += value * (static_cast<double>(y) + 0.5);
      }
    }
    REQUIRE(sum > 10);
    const auto in_camera = geometry::transform(pose, {place.x, place.y, place.z});
    const auto expected = geometry::project(camera, in_camera);
    CHECK(u / sum == Approx(expected[0]).margin(0.06));
    CHECK(v / sum == Approx(expected[1]).margin(0.06));
    const auto at = static_cast<size_t>(static_cast<int64_t>(expected[1]) * frame.width +
                                        static_cast<int64_t>(expected[0]));
    CHECK(frame.depth[at] == Approx(in_camera[2] - 0.04).margin(0.003));
  }
}

TEST_CASE("ray caster: the nearer surface hides the other, see-through ones let through",
          "[world]") {
  WorldBuilder s("layers", 1);
  const int red = s.material(Canvas(4, 4, {1, 0, 0}), 1.0f);
  const int green = s.material(Canvas(4, 4, {0, 1, 0}), 1.0f);
  s.quad({-1, 1, 0}, {2, 0, 0}, {0, -2, 0}, red);
  Canvas half(64, 64, {0, 1, 0});
  half.cut([](float u, float) { return u < 0.5f; });
  s.quad({-1, 1, 0.5f}, {2, 0, 0}, {0, -2, 0}, s.cutout(half));
  s.box({0, -1.2f, 1}, {0.4f, 0.4f, 0.1f}, green);
  const World scene = s.finish();
  const auto hit_from = [&](Vec3 origin) {
    Hit hit{1e6f};
    cast(scene, {origin, {0, 0, -1}}, 0.002f, hit);
    return hit;
  };
  CHECK(hit_from({-0.5f, 0.2f, 3}).t == Approx(2.5));
  CHECK(hit_from({0.5f, 0.2f, 3}).t == Approx(3.0));
  CHECK(hit_from({0.0f, -0.95f, 3}).t == Approx(1.95));
  CHECK(hit_from({2.0f, 0.0f, 3}).primitive == -1);
}

TEST_CASE("ray caster: surfaces report points that lie on them", "[world]") {
  const Primitive shapes[] = {
      make_quad({-1, 1, 0.2f}, {2, 0.1f, 0.3f}, {0.2f, -2, 0.1f}, 0),
      make_disc({0, 0, 0}, {0.8f, 0, 0}, {0, -0.8f, 0.2f}, 0),
      make_tube({-0.2f, -1, 0}, {0.3f, 1, 0.2f}, 0.5f, 0.2f, 0),
      make_ellipsoid({0.1f, 0, 0}, {0.8f, 0, -0.6f}, {0, 1, 0}, {0.7f, 0.4f, 0.5f}, 0)};
  for (const Primitive& shape : shapes) {
    const Bounds box = bounds_of(shape);
    int met = 0;
    for (float x = -0.9f; x < 1; x += 0.17f) {
      for (float y = -0.9f; y < 1; y += 0.17f) {
        const Ray ray{{0.5f * x, 0.3f, 4}, {0.125f * x, 0.25f * y - 0.075f, -1}};
        Hit hit{1e6f};
        if (!intersect(shape, ray, hit)) continue;
        ++met;
        const Vec3 along = ray.origin + ray.direction * hit.t;
        const SurfacePoint on = surface_point(shape, hit.u, hit.v);
        CHECK(length(along - on.position) < 1e-3f);
        CHECK(length(on.normal) == Approx(1).margin(1e-4));
        CHECK((along.x >= box.low.x && along.y >= box.low.y && along.z >= box.low.z));
        CHECK((along.x <= box.high.x && along.y <= box.high.y && along.z <= box.high.z));
      }
    }
    CHECK(met > 5);
  }
}

TEST_CASE("ray caster: scenes follow their seed, not the threads", "[world]") {
  const auto camera = geometry::Intrinsics::centred(70, 48, 36);
  const int threads = at::get_num_threads();
  const auto picture = [&](uint64_t seed, int count) {
    at::set_num_threads(count);
    const RayCaster world(make_world("clutter", seed));
    SharpFrame frame;
    world.render(geometry::look_at({0, 1, 2.4}, {0, 0.9, -0.3}, {0, 1, 0}), camera, 4, frame);
    at::set_num_threads(threads);
    return frame.rgb;
  };
  const auto first = picture(3, 1);
  CHECK(first == picture(3, 3));
  CHECK_FALSE(first == picture(4, 1));
}

TEST_CASE("scenes: every one fills the picture with detail between dark and bright",
          "[world][slow]") {
  const auto camera = geometry::Intrinsics::centred(110, 84, 64);
  for (const auto& name : world_names()) {
    INFO(name);
    const RayCaster world(make_world(name, 11));
    const CameraRig& rig = world.world().rig;
    SharpFrame frame;
    world.render(geometry::look_at({rig.eye.x, rig.eye.y, rig.eye.z},
                                   {rig.target.x, rig.target.y, rig.target.z}, {0, 1, 0}),
                 camera, 4, frame);
    double mean = 0, square = 0;
    float nearest = 1e9f, furthest = 0;
    for (size_t i = 0; i < frame.depth.size(); ++i) {
      mean += frame.rgb[i], square += static_cast<double>(frame.rgb[i]) * frame.rgb[i];
      CHECK((frame.rgb[i] >= 0 && frame.rgb[i] <= 1));
      nearest = std::min(nearest, frame.depth[i]), furthest = std::max(furthest, frame.depth[i]);
    }
    mean /= static_cast<double>(frame.depth.size());
    const double deviation =
        std::sqrt(square / static_cast<double>(frame.depth.size()) - mean * mean);
    CHECK((mean > 0.1 && mean < 0.75));
    CHECK(deviation > 0.08);
    CHECK(furthest < kNoDepth);
    CHECK(furthest > 1.4f * nearest);
  }
  CHECK_THROWS_AS(make_world("moon", 1), ConfigError);
}
