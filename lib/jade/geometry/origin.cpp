// SPDX-License-Identifier: Apache-2.0
#include "jade/geometry/origin.h"

#include <cmath>
#include <cstdio>

namespace jade::geometry {
namespace {

/// Distance in units of the scene's size. There float32 has steps of 3e-5 of the size, about the
/// smallest steps with which training moves Gaussians.
constexpr double kFar = 256;

}  // namespace

Vector3 scene_origin(const Vector3& middle, double size) {
  const double distance =
      std::sqrt(middle[0] * middle[0] + middle[1] * middle[1] + middle[2] * middle[2]);
  const double known = size > 0 && std::isfinite(size) ? size : 1;
  if (!(distance > kFar * known) || !std::isfinite(distance)) return {0, 0, 0};
  const double step = std::pow(10, std::floor(std::log10(known)));
  Vector3 origin{};
  // For a step below 1, divide by its inverse, which gives a short decimal.
  for (size_t axis = 0; axis < 3; ++axis) {
    origin[axis] = step < 1 ? std::round(middle[axis] / step) / std::round(1 / step)
                            : std::round(middle[axis] / step) * step;
  }
  return origin;
}

Pose with_origin(const Pose& camera_from_world, const Vector3& origin) {
  return {camera_from_world.rotation, transform(camera_from_world, origin)};
}

bool is_zero(const Vector3& vector) { return vector[0] == 0 && vector[1] == 0 && vector[2] == 0; }

std::string text_of(const Vector3& vector) {
  char text[96];
  std::snprintf(text, sizeof text, "%.15g %.15g %.15g", vector[0], vector[1], vector[2]);
  return text;
}

}  // namespace jade::geometry
