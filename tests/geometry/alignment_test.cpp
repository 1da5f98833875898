// SPDX-License-Identifier: Apache-2.0
#include "jade/geometry/alignment.h"

#include "support/catch.h"

#include <cmath>
#include <random>

using namespace jade::geometry;

namespace {

const Similarity kDrift{0.8, rotation_from_vector({0.4, -1.1, 2.0}), {3, -2, 0.5}};

std::vector<Pose> random_cameras(int count, bool on_a_line) {
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  std::vector<Pose> cameras;
  for (int i = 0; i < count; ++i) {
    const Matrix3 rotation = rotation_from_vector({normal(random), normal(random), normal(random)});
    const Vector3 centre = on_a_line ? Vector3{0.1 * i, 0.2 * i, 0.3 * i}
                                     : Vector3{normal(random), normal(random), normal(random)};
    cameras.push_back(pose_at_centre(rotation, centre));
  }
  return cameras;
}

std::vector<Pose> drifted(const std::vector<Pose>& cameras, const Similarity& drift) {
  std::vector<Pose> out;
  for (const Pose& camera : cameras) out.push_back(moved(camera, drift));
  return out;
}

void check_same(const Similarity& a, const Similarity& b) {
  CHECK(a.scale == Approx(b.scale));
  for (size_t i = 0; i < 9; ++i) CHECK(a.rotation[i] == Approx(b.rotation[i]).margin(1e-12));
  for (size_t i = 0; i < 3; ++i) CHECK(a.translation[i] == Approx(b.translation[i]).margin(1e-12));
}

}  // namespace

TEST_CASE("alignment: a moved camera sees the moved points in the same pixels", "[geometry]") {
  const Pose camera = random_cameras(1, false).front(), there = moved(camera, kDrift);
  const Vector3 point{0.3, -0.7, 1.9};
  Vector3 moved_point = transform({kDrift.rotation, {0, 0, 0}}, point);
  for (int i = 0; i < 3; ++i) {
    moved_point[i] = kDrift.scale * moved_point[i] + kDrift.translation[i];
  }
  const Vector3 here = transform(camera, point), other = transform(there, moved_point);
  for (int i = 0; i < 3; ++i) CHECK(other[i] == Approx(kDrift.scale * here[i]));
}

TEST_CASE("alignment: the similarity between two worlds is found, on a straight path too",
          "[geometry]") {
  for (const bool on_a_line : {false, true}) {
    const std::vector<Pose> cameras = random_cameras(6, on_a_line);
    check_same(align_cameras(cameras, drifted(cameras, kDrift)), kDrift);
  }
}

TEST_CASE("alignment: cameras at one place turn and move but keep scale 1", "[geometry]") {
  std::vector<Pose> cameras = random_cameras(4, false);
  for (Pose& camera : cameras) camera = pose_at_centre(camera.rotation, {1, 2, 3});
  const Similarity drift{1, kDrift.rotation, kDrift.translation};
  check_same(align_cameras(cameras, drifted(cameras, drift)), drift);
}

TEST_CASE("alignment: is the best of its neighbours where the cameras disagree", "[geometry]") {
  const std::vector<Pose> cameras = random_cameras(8, false);
  std::vector<Pose> other = drifted(cameras, kDrift);
  std::mt19937 random(9);
  std::normal_distribution<double> normal(0, 0.02);
  for (Pose& camera : other) {
    Vector3 place = centre(camera);
    for (double& value : place) value += normal(random);
    camera = pose_at_centre(camera.rotation, place);
  }
  const auto error = [&](const Similarity& s) {
    double sum = 0;
    for (size_t i = 0; i < cameras.size(); ++i) {
      const Vector3 a = centre(moved(cameras[i], s)), b = centre(other[i]);
      for (int k = 0; k < 3; ++k) sum += (a[k] - b[k]) * (a[k] - b[k]);
    }
    return sum;
  };
  const Similarity best = align_cameras(cameras, other);
  for (const double step : {-1e-3, 1e-3}) {
    Similarity scaled = best;
    scaled.scale += step;
    CHECK(error(scaled) > error(best));
    for (int k = 0; k < 3; ++k) {
      Similarity shifted = best;
      shifted.translation[k] += step;
      CHECK(error(shifted) > error(best));
    }
  }
}

TEST_CASE("alignment: the rotation is the one nearest to all, and mirrored centres keep scale 1",
          "[geometry]") {
  const std::vector<Pose> cameras = random_cameras(7, false);
  std::vector<Pose> other = drifted(cameras, kDrift);
  std::mt19937 random(11);
  std::normal_distribution<double> normal(0, 0.2);
  for (Pose& camera : other) {
    const Pose turn{rotation_from_vector({normal(random), normal(random), normal(random)}), {}};
    camera = compose(turn, camera);
  }
  const auto distance = [&](const Matrix3& rotation) {
    double sum = 0;
    for (size_t i = 0; i < cameras.size(); ++i) {
      const Matrix3 a = moved(cameras[i], {1, rotation, {}}).rotation, b = other[i].rotation;
      for (size_t k = 0; k < 9; ++k) sum += (a[k] - b[k]) * (a[k] - b[k]);
    }
    return sum;
  };
  const Matrix3 best = align_cameras(cameras, other).rotation;
  for (const double angle : {-1e-3, 1e-3}) {
    for (int axis = 0; axis < 3; ++axis) {
      Vector3 vector{};
      vector[axis] = angle;
      const Pose turned = compose({rotation_from_vector(vector), {}}, {best, {}});
      CHECK(distance(turned.rotation) > distance(best));
    }
  }
  other = cameras;
  for (Pose& camera : other) {
    const Vector3 c = centre(camera);
    camera = pose_at_centre(camera.rotation, {-c[0], -c[1], -c[2]});
  }
  CHECK(align_cameras(cameras, other).scale == 1);
}
