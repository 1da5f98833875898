// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/moving_object.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace jade::simulate {
namespace {

constexpr double kSwing = 6.283185307179586;
constexpr int kRays = 3;  // per pixel and axis

struct Hit {
  double depth = 0;
  std::array<float, 3> rgb{};
};

/// The ball's light where the ray through (u, v) hits it; depth 0 if it misses.
Hit meet(const geometry::Intrinsics& camera, double u, double v, const geometry::Vector3& centre,
         double radius, const geometry::Pose& pose) {
  const auto ray = geometry::unproject(camera, u, v);
  const auto dot = [](const auto& a, const auto& b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  };
  const double a = dot(ray, ray), b = dot(ray, centre);
  const double root = b * b - a * (dot(centre, centre) - radius * radius);
  if (root <= 0) return {};
  const double depth = (b - std::sqrt(root)) / a;
  if (depth <= 0) return {};
  geometry::Vector3 normal;
  for (size_t i = 0; i < 3; ++i) normal[i] = (depth * ray[i] - centre[i]) / radius;
  // Stripes are fixed to the ball, which does not rotate, in world axes.
  const auto world =
      geometry::transform(geometry::Pose{geometry::inverse(pose).rotation, {0, 0, 0}}, normal);
  const bool stripe = std::sin(8 * world[0]) * std::sin(6 * world[1]) > 0;
  const auto shade = static_cast<float>(0.55 - 0.35 * normal[2]);
  return {depth, stripe ? std::array<float, 3>{shade, 0.25f * shade, 0.15f * shade}
                        : std::array<float, 3>{0.95f * shade, 0.95f * shade, 0.85f * shade}};
}

}  // namespace

MovingObject::MovingObject(const ObjectOptions& options, const geometry::Intrinsics& camera,
                           const geometry::Pose& from, double depth)
    : options_(options),
      world_from_middle_(geometry::inverse(from)),
      depth_(depth),
      radius_(options.radius_px * depth / camera.fx),
      px_(depth / camera.fx) {}

geometry::Vector3 MovingObject::centre_at(double t_us) const {
  const double turn = kSwing * t_us / (1000 * options_.period_ms);
  const double side = options_.travel_px * px_;
  return geometry::transform(world_from_middle_,
                             {side * std::sin(turn), 0.3 * side * std::sin(2 * turn), depth_});
}

double MovingObject::time_for_us(double px) const {
  const double fastest = kSwing * std::hypot(1, 0.6) * options_.travel_px;  // px per period
  return fastest > 0 ? px * 1000 * options_.period_ms / fastest
                     : std::numeric_limits<double>::infinity();
}

void MovingObject::draw(const geometry::Intrinsics& camera, const geometry::Pose& pose, double t_us,
                        world::SharpFrame& frame) const {
  const auto centre = geometry::transform(pose, centre_at(t_us));
  if (centre[2] <= 1.01 * radius_) return;
  const auto middle = geometry::project(camera, centre);
  const double reach = 1.5 * radius_ * camera.fx / (centre[2] - radius_) + 1;
  const auto bound = [](double value, int64_t size) {
    return static_cast<int64_t>(std::clamp(value, 0.0, static_cast<double>(size)));
  };
  const auto pixels = static_cast<size_t>(frame.width * frame.height);
  for (int64_t y = bound(middle[1] - reach, frame.height);
       y < bound(middle[1] + reach, frame.height); ++y) {
    for (int64_t x = bound(middle[0] - reach, frame.width);
         x < bound(middle[0] + reach, frame.width); ++x) {
      const auto i = static_cast<size_t>(y * frame.width + x);
      std::array<float, 3> sum{};
      float covered = 0;
      for (int ray = 0; ray < kRays * kRays; ++ray) {
        const Hit hit =
            meet(camera, static_cast<double>(x) + (ray % kRays + 0.5) / kRays,
                 static_cast<double>(y) + (ray / kRays + 0.5) / kRays, centre, radius_, pose);
        if (hit.depth <= 0 || hit.depth >= frame.depth[i]) continue;
        for (size_t c = 0; c < 3; ++c) sum[c] += hit.rgb[c];
        covered += 1;
      }
      constexpr float kAll = kRays * kRays;
      for (size_t c = 0; c < 3; ++c) {
        float& value = frame.rgb[c * pixels + i];
        value = (1 - covered / kAll) * value + sum[c] / kAll;
      }
    }
  }
}

}  // namespace jade::simulate
