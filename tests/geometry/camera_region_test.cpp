// SPDX-License-Identifier: Apache-2.0
#include "jade/geometry/camera_region.h"

#include "support/catch.h"

#include <cmath>

namespace jade::geometry {
namespace {

std::vector<Vector3> orbit(size_t count, double radius = 1) {
  std::vector<Vector3> centres;
  for (size_t i = 0; i < count; ++i) {
    const double angle = 6.283 * double(i) / double(count);
    centres.push_back({radius * std::cos(angle), 0.1 * double(i % 3), radius * std::sin(angle)});
  }
  return centres;
}

size_t strays(const std::vector<Vector3>& centres, double depth) {
  const CameraRegion region = camera_region(centres, depth);
  size_t count = 0;
  for (const Vector3& centre : centres) count += region.contains(centre) ? 0 : 1;
  return count;
}

TEST_CASE("camera region: a small minority far from all others is outside", "[geometry]") {
  for (const double depth : {0.0, 2.0}) {
    std::vector<Vector3> centres = orbit(30);
    CHECK(strays(centres, depth) == 0);
    centres.push_back({1000, 0, 0});
    CHECK(strays(centres, depth) == 1);
    centres.insert(centres.begin(), {0, -80, 0});
    CHECK(strays(centres, depth) == 2);
    centres.push_back({0, 1e6, 0});
    CHECK(strays(centres, depth) == 3);
  }
  std::vector<Vector3> few = orbit(4);
  few.push_back({1000, 0, 0});
  CHECK(strays(few, 2) == 1);
}

TEST_CASE("camera region: honest paths are inside", "[geometry]") {
  std::vector<Vector3> corridor, speeding, leaving, clusters = orbit(12);
  for (int i = 0; i < 40; ++i) {
    corridor.push_back({0, 0, 5.0 * i});
    speeding.push_back({0, 0, 0.01 * std::pow(1.3, i)});
    // Trembles at one place, then walks away.
    leaving.push_back({1e-3 * std::sin(i), 0, i < 34 ? 0 : 0.1 * (i - 33)});
  }
  for (Vector3 centre : orbit(10)) {
    centre[0] += 500;
    clusters.push_back(centre);
  }
  for (const double depth : {0.0, 2.0}) {
    CHECK(strays(corridor, depth) == 0);
    CHECK(strays(speeding, depth) == 0);
    CHECK(strays(leaving, depth) == 0);
    CHECK(strays(clusters, depth) == 0);
  }
  // Cameras at one place have no size; only the depth says what is far.
  std::vector<Vector3> turning(20, Vector3{1, 2, 3});
  turning.push_back({1.5, 2, 3});
  CHECK(strays(turning, 0) == 0);
  CHECK(strays(turning, 2) == 0);
  turning.back()[0] = 100;
  CHECK(strays(turning, 2) == 1);
}

}  // namespace
}  // namespace jade::geometry
