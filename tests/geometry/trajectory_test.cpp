// SPDX-License-Identifier: Apache-2.0
#include "jade/geometry/trajectory.h"

#include "support/catch.h"

#include <cmath>

#include "jade/core/error.h"

using namespace jade::geometry;

namespace {

/// A camera whose centre moves on a cubic and which rotates at constant speed about one axis.
Pose analytic_pose(double t_us) {
  const double s = t_us * 1e-6;
  const Vector3 c{1 + 2 * s - 3 * s * s + s * s * s, -s * s * s, 0.5 - s};
  return pose_at_centre(rotation_from_vector({0.3 * s, -0.6 * s, 0.9 * s}), c);
}

void check_same(const Pose& a, const Pose& b, double tolerance) {
  CHECK(rotation_angle(a, b) < tolerance);
  for (int i = 0; i < 3; ++i) CHECK(a.translation[i] == Approx(b.translation[i]).margin(tolerance));
}

}  // namespace

TEST_CASE("trajectory: cubic centres and even turns are reproduced between uneven knots",
          "[geometry]") {
  const std::vector<double> times{0, 1e5, 2.5e5, 3e5, 7e5, 8e5, 1.1e6};
  std::vector<Pose> poses;
  for (const double t : times) poses.push_back(analytic_pose(t));
  const Trajectory path(times, poses);
  for (double t = 0; t <= 1.1e6; t += 13577) check_same(path.at(t), analytic_pose(t), 1e-9);
}

TEST_CASE("trajectory: knots are met and times outside get the nearest end", "[geometry]") {
  const std::vector<double> times{10, 20, 40, 50};
  std::vector<Pose> poses;
  for (const double t : times) poses.push_back(analytic_pose(3e4 * t));
  const Trajectory path(times, poses);
  for (size_t i = 0; i < times.size(); ++i) check_same(path.at(times[i]), poses[i], 1e-9);
  check_same(path.at(-1e9), poses.front(), 1e-9);
  check_same(path.at(1e9), poses.back(), 1e-9);
}

TEST_CASE("trajectory: one, two and three poses give rest, a line and a parabola", "[geometry]") {
  const auto at = [](double x) { return pose_at_centre(Pose{}.rotation, {x, 0, 0}); };
  CHECK(centre(Trajectory({5}, {at(2)}).at(99))[0] == Approx(2));
  CHECK(centre(Trajectory({0, 10}, {at(0), at(1)}).at(2.5))[0] == Approx(0.25));
  const Trajectory parabola({0, 1, 3}, {at(0), at(1), at(9)});
  for (const double t : {0.25, 0.9, 1.7, 2.9}) CHECK(centre(parabola.at(t))[0] == Approx(t * t));
}

TEST_CASE("trajectory: the nine exposure poses are evenly spaced with the middle at index 4",
          "[geometry]") {
  const auto times = exposure_times(1000, 9001);
  CHECK(times[0] == 1000);
  CHECK(times[8] == 9001);
  CHECK(times[kMidPose] == Approx(5000.5));
  std::vector<Pose> poses;
  for (const double t : {0., 5e3, 1e4, 2e4}) poses.push_back(analytic_pose(t));
  const Trajectory path({0, 5e3, 1e4, 2e4}, poses);
  const auto nine = path.exposure_poses(1000, 9001);
  for (int k = 0; k < kExposurePoses; ++k) check_same(nine[k], analytic_pose(times[k]), 1e-9);
}

TEST_CASE("trajectory: centres are interpolated, so turning on the spot does not move the camera",
          "[geometry]") {
  std::vector<Pose> poses;
  for (int i = 0; i < 5; ++i)
    poses.push_back(pose_at_centre(rotation_from_vector({0, 1.0 * i, 0}), {4, 5, 6}));
  const Trajectory path({0, 1, 2, 3, 4}, poses);
  const Vector3 c = centre(path.at(1.37));
  CHECK(c[0] == Approx(4));
  CHECK(c[1] == Approx(5));
  CHECK(c[2] == Approx(6));
}

TEST_CASE("trajectory: its mirror image continues a camera at constant velocity", "[geometry]") {
  const auto steady = [](double t) {
    return pose_at_centre(rotation_from_vector({0.3e-6 * t, 0, 0}), {2e-6 * t, 1 - 1e-6 * t, 0});
  };
  const Trajectory path({1e5, 2e5, 4e5}, {steady(1e5), steady(2e5), steady(4e5)});
  const Trajectory longer = path.spanning(2e4, 5e5);
  CHECK(longer.size() == 5);
  for (double t = 2e4; t <= 5e5; t += 16000) check_same(longer.at(t), steady(t), 1e-9);
  // A path that is long enough is unchanged.
  CHECK(path.spanning(1e5, 4e5).size() == 3);
  CHECK(path.spanning(3e5, 6e5).begin_us() == 1e5);
  // A camera with one pose is static.
  check_same(Trajectory({1e5}, {steady(1e5)}).spanning(0, 3e5).at(2.5e5), steady(1e5), 1e-9);
}

TEST_CASE("trajectory: bad input is refused", "[geometry]") {
  CHECK_THROWS_AS(Trajectory({}, {}), jade::ContractError);
  CHECK_THROWS_AS(Trajectory({1, 1}, {Pose{}, Pose{}}), jade::ContractError);
  CHECK_THROWS_AS(Trajectory({1, 2}, {Pose{}}), jade::ContractError);
  CHECK_THROWS_AS(Trajectory({1, std::nan("")}, {Pose{}, Pose{}}), jade::ContractError);
  CHECK_THROWS_AS(exposure_times(2, 1), jade::ContractError);
  CHECK_THROWS_AS(Trajectory().spanning(0, 1), jade::ContractError);
}
