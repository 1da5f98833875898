// SPDX-License-Identifier: Apache-2.0
#include "jade/geometry/pose.h"

#include "support/catch.h"

#include <cmath>
#include <random>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/geometry/camera.h"

using namespace jade::geometry;

namespace {

constexpr double kPi = 3.14159265358979323846;

Pose random_pose(std::mt19937& random) {
  std::normal_distribution<double> normal;
  const Quaternion q{normal(random), normal(random), normal(random), normal(random)};
  return {rotation_from_quaternion(q), {normal(random), normal(random), normal(random)}};
}

void check_same(const Pose& a, const Pose& b) {
  for (size_t i = 0; i < 9; ++i) CHECK(a.rotation[i] == Approx(b.rotation[i]).margin(1e-12));
  for (size_t i = 0; i < 3; ++i) CHECK(a.translation[i] == Approx(b.translation[i]).margin(1e-12));
}

}  // namespace

TEST_CASE("pose: inverse and compose behave as 4x4 matrices do", "[geometry]") {
  std::mt19937 random(1);
  for (int i = 0; i < 20; ++i) {
    const Pose a = random_pose(random), b = random_pose(random);
    check_same(compose(a, inverse(a)), Pose{});
    check_same(pose_from_tensor(torch::matmul(to_tensor(a), to_tensor(b))), compose(a, b));
    check_same(pose_from_tensor(torch::linalg_inv(to_tensor(a))), inverse(a));
    const Vector3 c = centre(a), zero = transform(a, c);
    for (const double v : zero) CHECK(v == Approx(0).margin(1e-12));
    check_same(pose_at_centre(a.rotation, c), a);
  }
}

TEST_CASE("pose: quaternions and matrices convert both ways at every angle", "[geometry]") {
  std::mt19937 random(2);
  for (int i = 0; i < 200; ++i) {
    const Pose a = random_pose(random);
    check_same({rotation_from_quaternion(quaternion_from_rotation(a.rotation)), {}},
               {a.rotation, {}});
  }
  for (const Vector3& half_turn : {Vector3{kPi, 0, 0}, Vector3{0, kPi, 0}, Vector3{0, 0, kPi}}) {
    const Matrix3 r = rotation_from_vector(half_turn);
    check_same({rotation_from_quaternion(quaternion_from_rotation(r)), {}}, {r, {}});
  }
  const Quaternion quarter = quaternion_from_rotation({0, -1, 0, 1, 0, 0, 0, 0, 1});  // 90° about z
  CHECK(quarter[0] == Approx(std::sqrt(0.5)));
  CHECK(quarter[3] == Approx(std::sqrt(0.5)));
  CHECK_THROWS_AS(rotation_from_quaternion({0, 0, 0, 0}), jade::ContractError);
}

TEST_CASE("pose: slerp turns evenly and takes the shorter arc", "[geometry]") {
  const auto turn = [](double angle) {
    return quaternion_from_rotation(rotation_from_vector({0, angle, 0}));
  };
  for (const double s : {0.0, 0.3, 1.0}) {
    Quaternion b = turn(1.4);
    for (double& v : b) v = -v;  // the same rotation
    const Pose got{rotation_from_quaternion(slerp(turn(0.2), b, s)), {}};
    check_same(got, {rotation_from_vector({0, 0.2 + 1.2 * s, 0}), {}});
  }
  check_same({rotation_from_quaternion(slerp(turn(0.5), turn(0.5), 0.5)), {}},
             {rotation_from_vector({0, 0.5, 0}), {}});
}

TEST_CASE("pose: look at puts the target on the axis and up at the top of the image",
          "[geometry]") {
  const Pose pose = look_at({1, 2, 3}, {4, 6, 3}, {0, 0, 1});
  const Vector3 target = transform(pose, {4, 6, 3}), above = transform(pose, {4, 6, 4});
  CHECK(target[0] == Approx(0).margin(1e-12));
  CHECK(target[1] == Approx(0).margin(1e-12));
  CHECK(target[2] == Approx(5));
  CHECK(above[1] < 0);
  CHECK(rotation_angle(pose, pose) == Approx(0).margin(1e-7));
  CHECK_THROWS_AS(look_at({0, 0, 0}, {0, 0, 1}, {0, 0, 2}), jade::ContractError);
}

TEST_CASE("pose: matrices rounded in files become rotations again, others are refused",
          "[geometry]") {
  std::mt19937 random(3);
  Matrix3 r = random_pose(random).rotation;
  const Matrix3 exact = r;
  for (double& v : r) v = std::round(v * 1e4) / 1e4;
  check_same(compose({nearest_rotation(r), {}}, inverse({nearest_rotation(r), {}})), Pose{});
  for (size_t i = 0; i < 9; ++i) CHECK(nearest_rotation(r)[i] == Approx(exact[i]).margin(1e-4));
  CHECK_THROWS_AS(nearest_rotation({2, 0, 0, 0, 2, 0, 0, 0, 2}), jade::ContractError);
  CHECK_THROWS_AS(nearest_rotation({-1, 0, 0, 0, 1, 0, 0, 0, 1}), jade::ContractError);
}

TEST_CASE("camera: of an image made narrower and lower by other ratios each axis keeps its own",
          "[geometry]") {
  const Intrinsics uneven = scaled({100, 90, 18, 16, 40, 30}, 10, 15);
  CHECK(uneven == Intrinsics{25, 45, 4.5, 8, 10, 15});
}

TEST_CASE("camera: projection and its inverse agree, pixel centres are at one half", "[geometry]") {
  const auto camera = Intrinsics::centred(100, 40, 30);
  CHECK(project(camera, {0, 0, 2})[0] == Approx(20));
  const auto direction = unproject(camera, 3.5, 7.5);
  CHECK(project(camera, direction)[0] == Approx(3.5));
  CHECK(project(camera, direction)[1] == Approx(7.5));
  const auto half = scaled(camera, 20, 15);
  CHECK(half.fx == Approx(50));
  CHECK(half.cy == Approx(7.5));
  CHECK(half != camera);
  CHECK(to_tensor(camera)[0].item<double>() == 100);
  CHECK_THROWS_AS(check_camera({0, 1, 1, 1, 4, 4}, "camera"), jade::ContractError);
}
