// SPDX-License-Identifier: Apache-2.0
#include "jade/geometry/rectification.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <torch/types.h>

#include "jade/core/check.h"

namespace jade::geometry {
namespace {

constexpr double kWidestTangent = 2.75;  // tangent of 70 degrees
constexpr double kNowhere = std::numeric_limits<double>::quiet_NaN();

/// Fills a [2,H,W] map with place(column, row), row by row in threads.
template <class Place>
torch::Tensor make_map(int64_t height, int64_t width, const Place& place) {
  auto map = torch::empty({2, height, width}, torch::kFloat32);
  float* data = map.mutable_data_ptr<float>();
  at::parallel_for(0, height, 8, [&](int64_t begin, int64_t end) {
    for (int64_t row = begin; row < end; ++row) {
      for (int64_t column = 0; column < width; ++column) {
        const auto [x, y] = place(double(column), double(row));
        data[row * width + column] = float(x);
        data[(height + row) * width + column] = float(y);
      }
    }
  });
  return map;
}

std::array<double, 2> pixel_index(const std::array<double, 2>& place) {
  return {place[0] - 0.5, place[1] - 0.5};
}

/// Pixel index of a direction in a pinhole; NaN behind it.
std::array<double, 2> pinhole_index(const Intrinsics& camera, const Vector3& direction) {
  if (!(direction[2] > 1e-6)) return {kNowhere, kNowhere};
  return pixel_index(project(camera, direction));
}

/// Visits the centres of the pixels at an image's border, in projection coordinates.
template <class Visit>
void for_border(const Intrinsics& camera, const Visit& visit) {
  const double right = double(camera.width) - 0.5, bottom = double(camera.height) - 0.5;
  for (double u = 0.5; u <= right; u += 1) visit(u, 0.5), visit(u, bottom);
  for (double v = 0.5; v <= bottom; v += 1) visit(0.5, v), visit(right, v);
}

/// Whether every border pixel of the pinhole has content in the raw image.
bool is_filled(const LensCamera& raw, const Intrinsics& pinhole) {
  bool filled = true;
  for_border(pinhole, [&](double u, double v) {
    if (!filled) return;
    const auto [x, y] = pixel_index(raw.project(unproject(pinhole, u, v)));
    filled = x >= 0 && y >= 0 && x <= double(raw.pinhole().width - 1) &&
             y <= double(raw.pinhole().height - 1);
  });
  return filled;
}

double filled_focal(const LensCamera& raw) {
  const Intrinsics& size = raw.pinhole();
  const auto fits = [&](double focal) {
    return is_filled(raw, Intrinsics::centred(focal, size.width, size.height));
  };
  double narrow = std::max(size.fx, size.fy);
  for (int i = 0; i < 20 && !fits(narrow); ++i) narrow *= 1.25;
  JADE_CHECK(fits(narrow), "the lens shows nothing around its axis; fx ", size.fx, ", cx ", size.cx,
             ", cy ", size.cy, " of ", size.width, "x", size.height);
  double wide = narrow;
  for (int i = 0; i < 40 && fits(wide); ++i) narrow = wide, wide /= 1.1;
  for (int i = 0; i < 40; ++i) {
    const double middle = 0.5 * (narrow + wide);
    (fits(middle) ? narrow : wide) = middle;
  }
  return narrow;
}

double whole_focal(const LensCamera& raw) {
  const Intrinsics& size = raw.pinhole();
  double across = 0, down = 0;
  for_border(size, [&](double u, double v) {
    const Vector3 direction = raw.unproject(u, v);
    if (std::isnan(direction[2])) return;
    const double sine = std::hypot(direction[0], direction[1]);
    const double tangent = direction[2] > 0 ? sine / direction[2] : kWidestTangent;
    const double scale = std::min(tangent, kWidestTangent) / std::max(sine, 1e-12);
    across = std::max(across, std::abs(direction[0]) * scale);
    down = std::max(down, std::abs(direction[1]) * scale);
  });
  JADE_CHECK(across > 0 && down > 0, "the lens has no inverse at any border pixel");
  return std::min(0.5 * double(size.width - 1) / across, 0.5 * double(size.height - 1) / down);
}

Vector3 times(const Matrix3& m, const Vector3& x) {
  return {m[0] * x[0] + m[1] * x[1] + m[2] * x[2], m[3] * x[0] + m[4] * x[1] + m[5] * x[2],
          m[6] * x[0] + m[7] * x[1] + m[8] * x[2]};
}

/// The direction in the first camera of the point that the second camera sees along `direction` on
/// the plane z = depth of the first; z ≤ 0 if there is none ahead.
Vector3 from_plane(const Pose& first_from_second, const Vector3& direction, double depth) {
  const Vector3 turned = times(first_from_second.rotation, direction);
  const double length = (depth - first_from_second.translation[2]) / turned[2];
  if (!(length > 0)) return {0, 0, -1};
  return {turned[0] * length + first_from_second.translation[0],
          turned[1] * length + first_from_second.translation[1], depth};
}

}  // namespace

Intrinsics rectified_camera(const LensCamera& raw, RectifiedField field) {
  const Intrinsics& size = raw.pinhole();
  const double focal = field == RectifiedField::kFilled ? filled_focal(raw) : whole_focal(raw);
  return Intrinsics::centred(focal, size.width, size.height);
}

torch::Tensor undistortion_map(const LensCamera& raw, const Intrinsics& rectified) {
  check_camera(rectified, "rectified camera");
  return make_map(rectified.height, rectified.width, [&](double column, double row) {
    return pixel_index(raw.project(unproject(rectified, column + 0.5, row + 0.5)));
  });
}

torch::Tensor rectification_map(const LensCamera& raw, const Intrinsics& rectified) {
  check_camera(rectified, "rectified camera");
  return make_map(raw.pinhole().height, raw.pinhole().width, [&](double column, double row) {
    return pinhole_index(rectified, raw.unproject(column + 0.5, row + 0.5));
  });
}

Matrix3 plane_homography(const Pose& second_from_first, double depth) {
  JADE_CHECK(depth > 0 && std::isfinite(depth), "expected a plane depth above 0, found ", depth);
  Matrix3 h = second_from_first.rotation;
  for (size_t i = 0; i < 3; ++i) h[3 * i + 2] += second_from_first.translation[i] / depth;
  return h;
}

torch::Tensor plane_map(const Rig& rig, const Intrinsics& rectified, double depth) {
  check_camera(rectified, "rectified camera");
  JADE_CHECK(depth > 0 && std::isfinite(depth), "expected a plane depth above 0, found ", depth);
  const Pose first_from_second = inverse(rig.second_from_first);
  const Intrinsics& size = rig.second.pinhole();
  return make_map(size.height, size.width, [&](double column, double row) {
    const Vector3 direction = rig.second.unproject(column + 0.5, row + 0.5);
    return pinhole_index(rectified, from_plane(first_from_second, direction, depth));
  });
}

Parallax plane_parallax(const Rig& rig, const Intrinsics& rectified, double depth, double actual) {
  constexpr int64_t kGrid = 16;
  const Pose first_from_second = inverse(rig.second_from_first);
  const Matrix3 to_second = plane_homography(rig.second_from_first, actual);
  Parallax result;
  int64_t count = 0;
  for (int64_t i = 0; i <= kGrid; ++i) {
    for (int64_t j = 0; j <= kGrid; ++j) {
      const double u = double(rectified.width * i) / kGrid,
                   v = double(rectified.height * j) / kGrid;
      const Vector3 seen = times(to_second, unproject(rectified, u, v));
      const Vector3 mapped = from_plane(first_from_second, seen, depth);
      if (!(seen[2] > 0) || !(mapped[2] > 0)) continue;
      const auto place = project(rectified, mapped);
      const double distance = std::hypot(place[0] - u, place[1] - v);
      result.mean_px += distance;
      result.largest_px = std::max(result.largest_px, distance);
      ++count;
    }
  }
  result.mean_px /= double(std::max<int64_t>(count, 1));
  return result;
}

}  // namespace jade::geometry
