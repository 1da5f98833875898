// SPDX-License-Identifier: Apache-2.0
#include "jade/geometry/rectification.h"

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

#include "jade/core/error.h"

using namespace jade::geometry;

namespace {

const LensCamera kBarrel({200, 205, 88, 61, 173, 130},
                         {LensModel::kRadialTangential, -0.35, 0.12, 1e-3, -7e-4, 0.01, 0, 0, 0});
const LensCamera kWide({90, 90, 85, 66, 173, 130},
                       {LensModel::kFisheye, 0.02, -0.008, 0, 0, 0.004, -0.001, 0, 0});

float entry(const torch::Tensor& map, int64_t axis, int64_t row, int64_t column) {
  return map[axis][row][column].item<float>();
}

/// Whether the whole map lies on the raw image.
bool inside(const torch::Tensor& map, const Intrinsics& raw) {
  return ((map[0] >= -1e-3) & (map[0] <= double(raw.width) - 1 + 1e-3) & (map[1] >= -1e-3) &
          (map[1] <= double(raw.height) - 1 + 1e-3))
      .all()
      .item<bool>();
}

}  // namespace

TEST_CASE("rectification: filled is the widest view without borders", "[geometry]") {
  for (const LensCamera& raw : {kBarrel, kWide}) {
    const Intrinsics camera = rectified_camera(raw, RectifiedField::kFilled);
    CHECK((camera.fx == camera.fy && camera.cx == 86.5 && camera.cy == 65));
    CHECK(inside(undistortion_map(raw, camera), raw.pinhole()));
    const Intrinsics wider = Intrinsics::centred(0.99 * camera.fx, 173, 130);
    CHECK_FALSE(inside(undistortion_map(raw, wider), raw.pinhole()));
  }
}

TEST_CASE("rectification: whole keeps every raw pixel", "[geometry]") {
  const Intrinsics camera = rectified_camera(kBarrel, RectifiedField::kWhole);
  CHECK(camera.fx < rectified_camera(kBarrel, RectifiedField::kFilled).fx);
  CHECK(inside(rectification_map(kBarrel, camera), camera));
  const Intrinsics narrower = Intrinsics::centred(1.01 * camera.fx, 173, 130);
  CHECK_FALSE(inside(rectification_map(kBarrel, narrower), narrower));
  // A fisheye that sees more than a plane can show is limited to 70 degrees.
  const LensCamera sphere({40, 40, 86, 65, 173, 130}, {LensModel::kFisheye});
  CHECK(rectified_camera(sphere, RectifiedField::kWhole).fx > 15);
}

TEST_CASE("rectification: without a lens nothing moves", "[geometry]") {
  const LensCamera plain(Intrinsics::centred(200, 173, 130), {});
  CHECK(rectified_camera(plain, RectifiedField::kFilled).fx == Approx(200).epsilon(1e-6));
  CHECK(rectified_camera(plain, RectifiedField::kWhole).fx == Approx(200).epsilon(1e-6));
  const auto map = undistortion_map(plain, plain.pinhole());
  CHECK(entry(map, 0, 7, 33) == Approx(33).margin(1e-4));
  CHECK(entry(map, 1, 7, 33) == Approx(7).margin(1e-4));
}

TEST_CASE("rectification: the maps of frames and of events are inverse", "[geometry]") {
  const Intrinsics camera = rectified_camera(kBarrel, RectifiedField::kFilled);
  const auto frames = undistortion_map(kBarrel, camera);
  const auto events = rectification_map(kBarrel, camera);
  for (int64_t row = 4; row < 130; row += 9) {
    for (int64_t column = 4; column < 173; column += 7) {
      // An event at the raw pixel nearest to the source of a frame's content maps to the same place
      // up to that rounding, magnified by the lens.
      const double x = entry(frames, 0, row, column), y = entry(frames, 1, row, column);
      const auto i = int64_t(std::lround(y)), j = int64_t(std::lround(x));
      CHECK(entry(events, 0, i, j) == Approx(double(column)).margin(1.0));
      CHECK(entry(events, 1, i, j) == Approx(double(row)).margin(1.0));
      const auto direction = unproject(camera, double(column) + 0.5, double(row) + 0.5);
      const auto raw = kBarrel.project(direction);
      CHECK(x == Approx(raw[0] - 0.5).margin(1e-4));
      CHECK(y == Approx(raw[1] - 0.5).margin(1e-4));
    }
  }
}

TEST_CASE("rectification: a rig's plane agrees, other depths are as far off as is said",
          "[geometry]") {
  const Intrinsics camera = Intrinsics::centred(200, 173, 130);
  const LensCamera second({190, 190, 90, 60, 180, 128},
                          {LensModel::kRadialTangential, -0.2, 0, 0, 0, 0, 0, 0, 0});
  const Pose pose{rotation_from_vector({0.02, -0.03, 0.05}), {0.06, 0.01, -0.02}};
  const Rig rig{second, pose};
  const auto map = plane_map(rig, camera, 2);
  for (const auto& [x, y] : {std::pair{0.1, -0.2}, std::pair{-0.3, 0.1}}) {
    const Vector3 point{2 * x, 2 * y, 2};
    const auto seen = second.project(transform(pose, point));
    const auto want = project(camera, point);
    const auto j = int64_t(std::floor(seen[0])), i = int64_t(std::floor(seen[1]));
    CHECK(entry(map, 0, i, j) == Approx(want[0] - 0.5).margin(1.0));
    CHECK(entry(map, 1, i, j) == Approx(want[1] - 0.5).margin(1.0));
    const Matrix3 h = plane_homography(pose, 2);
    const double w = h[6] * x + h[7] * y + h[8];
    const Vector3 there = transform(pose, point);
    CHECK((h[0] * x + h[1] * y + h[2]) / w == Approx(there[0] / there[2]));
    CHECK((h[3] * x + h[4] * y + h[5]) / w == Approx(there[1] / there[2]));
  }
  CHECK(plane_parallax(rig, camera, 2, 2).largest_px < 1e-9);
  // Side by side, the parallax is focal length · baseline · |1/z − 1/depth|.
  const Rig beside{second, {Pose{}.rotation, {0.06, 0, 0}}};
  const Parallax near = plane_parallax(beside, camera, 2, 1);
  CHECK(near.mean_px == Approx(200 * 0.06 * 0.5).epsilon(1e-6));
  CHECK(near.largest_px == Approx(near.mean_px).epsilon(1e-6));
  CHECK(plane_parallax(beside, camera, 2, 1e9).mean_px == Approx(200 * 0.06 / 2).epsilon(1e-6));
  CHECK_THROWS_AS(plane_homography(pose, 0), jade::ContractError);
}
