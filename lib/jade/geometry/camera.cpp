// SPDX-License-Identifier: Apache-2.0
#include "jade/geometry/camera.h"

#include <cmath>
#include <torch/types.h>

#include "jade/core/check.h"

namespace jade::geometry {

Intrinsics Intrinsics::centred(double focal_px, int64_t width, int64_t height) {
  return {focal_px, focal_px, 0.5 * double(width), 0.5 * double(height), width, height};
}

bool operator==(const Intrinsics& a, const Intrinsics& b) {
  return a.fx == b.fx && a.fy == b.fy && a.cx == b.cx && a.cy == b.cy && a.width == b.width &&
         a.height == b.height;
}

bool operator!=(const Intrinsics& a, const Intrinsics& b) { return !(a == b); }

Intrinsics scaled(const Intrinsics& camera, int64_t width, int64_t height) {
  check_camera(camera, "camera to scale");
  const double sx = double(width) / double(camera.width);
  const double sy = double(height) / double(camera.height);
  return {camera.fx * sx, camera.fy * sy, camera.cx * sx, camera.cy * sy, width, height};
}

std::array<double, 2> project(const Intrinsics& camera, const std::array<double, 3>& point) {
  return {camera.fx * point[0] / point[2] + camera.cx, camera.fy * point[1] / point[2] + camera.cy};
}

std::array<double, 3> unproject(const Intrinsics& camera, double u, double v) {
  return {(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0};
}

torch::Tensor to_tensor(const Intrinsics& camera) {
  return torch::tensor({camera.fx, camera.fy, camera.cx, camera.cy}, torch::kFloat64);
}

void check_camera(const Intrinsics& camera, const std::string& what) {
  const bool finite = std::isfinite(camera.fx) && std::isfinite(camera.fy) &&
                      std::isfinite(camera.cx) && std::isfinite(camera.cy);
  JADE_CHECK(finite && camera.fx > 0 && camera.fy > 0 && camera.width > 0 && camera.height > 0,
             what, ": expected positive focal lengths and sizes, found fx ", camera.fx, ", fy ",
             camera.fy, ", cx ", camera.cx, ", cy ", camera.cy, ", ", camera.width, " x ",
             camera.height);
}

}  // namespace jade::geometry
