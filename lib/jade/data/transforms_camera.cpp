// SPDX-License-Identifier: Apache-2.0
#include "jade/data/transforms_camera.h"

#include <cmath>

#include "jade/core/error.h"
#include "jade/data/undistorter.h"

namespace jade::data {
namespace {

double focal_of(double angle, int64_t size) { return 0.5 * double(size) / std::tan(0.5 * angle); }

}  // namespace

geometry::Intrinsics sized_camera(const ListedView& view, int64_t width, int64_t height) {
  geometry::Intrinsics camera = view.camera;
  if (camera.width > 0 && camera.height > 0) return camera;
  camera.width = std::llround(double(width) * view.reduction);
  camera.height = std::llround(double(height) * view.reduction);
  return camera;
}

geometry::LensCamera fit_camera(const ListedView& view, int64_t width, int64_t height) {
  geometry::Intrinsics camera = sized_camera(view, width, height);
  if (view.angle_x > 0) camera.fx = focal_of(view.angle_x, camera.width);
  if (view.angle_y > 0) camera.fy = focal_of(view.angle_y, camera.height);
  // Assume square pixels if only one of the two is known.
  if (camera.fx == 0) camera.fx = camera.fy;
  if (camera.fy == 0) camera.fy = camera.fx;
  if (camera.cx == 0) camera.cx = 0.5 * double(camera.width);
  if (camera.cy == 0) camera.cy = 0.5 * double(camera.height);
  if (is_fraction(camera.cx)) camera.cx *= double(camera.width);
  if (is_fraction(camera.cy)) camera.cy *= double(camera.height);
  return {fit_to_picture(camera, width, height, view.path.string()), view.lens};
}

void DoubtfulCameras::look(const ListedView& view, const geometry::Intrinsics& fitted,
                           int64_t width, int64_t height) {
  const geometry::Intrinsics camera = sized_camera(view, width, height);
  const auto compare = [&](const char* axis, double angle, double focal, int64_t size) {
    constexpr double kMost = 0.03;
    if (angle == 0 || focal == 0) return false;
    const double other = focal_of(angle, size);
    if (std::abs(other - focal) <= kMost * focal) return false;
    if (differing_++ == 0) {
      example_ = concat("fl_", axis, " ", focal, " and camera_angle_", axis, " ", angle,
                        ", which is ", std::round(10 * other) / 10, " px for ", size, " px");
    }
    return true;
  };
  if (!compare("x", view.beside_x, camera.fx, camera.width))
    compare("y", view.beside_y, camera.fy, camera.height);
  const auto near_border = [](double place, int64_t size) {
    constexpr double kMargin = 0.1;
    return place < kMargin * double(size) || place > (1 - kMargin) * double(size);
  };
  if (!near_border(fitted.cx, fitted.width) && !near_border(fitted.cy, fitted.height)) return;
  if (beside_++ == 0) {
    centre_ = concat("(", fitted.cx, ", ", fitted.cy, ") in ", fitted.width, "x", fitted.height);
  }
}

void DoubtfulCameras::tell(const std::filesystem::path& path, const Warnings& warnings) const {
  if (differing_ > 0) {
    warnings.add(path.string(), ": expected one focal length, found ", example_, " (", differing_,
                 " frames); fl_x is used; correct or remove the wrong one");
  }
  if (beside_ > 0) {
    warnings.add(path.string(), ": expected a principal point (cx, cy) near the middle, found ",
                 centre_, " px (", beside_, " frames), as only crops have; if it counts from the ",
                 "middle of the image, add half of the image size");
  }
}

}  // namespace jade::data
