// SPDX-License-Identifier: Apache-2.0
#include "jade/geometry/camera_region.h"

#include <algorithm>
#include <cmath>

namespace jade::geometry {
namespace {

constexpr size_t kFewestCentres = 4;

double distance(const Vector3& a, const Vector3& b) {
  return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

Vector3 median_of(const std::vector<Vector3>& centres) {
  Vector3 middle{};
  for (size_t axis = 0; axis < 3; ++axis) {
    std::vector<double> places;
    places.reserve(centres.size());
    for (const Vector3& centre : centres) places.push_back(centre[axis]);
    const auto half = places.begin() + static_cast<std::ptrdiff_t>(places.size() / 2);
    std::nth_element(places.begin(), half, places.end());
    middle[axis] = *half;
  }
  return middle;
}

}  // namespace

bool CameraRegion::contains(const Vector3& centre) const {
  return !(distance(centre, middle) > radius);
}

CameraRegion camera_region(const std::vector<Vector3>& centres, double depth) {
  CameraRegion region;
  if (centres.size() < kFewestCentres) return region;
  const bool is_known = depth > 0;
  const double gap = is_known ? 10 : 30;
  const size_t most = std::max<size_t>(1, centres.size() / (is_known ? 4 : 10));
  region.middle = median_of(centres);
  std::vector<double> away;
  away.reserve(centres.size());
  for (const Vector3& centre : centres) away.push_back(distance(centre, region.middle));
  std::sort(away.begin(), away.end());
  for (size_t i = away.size() - most; i < away.size(); ++i) {
    const double usual = std::max(away[i - 1], depth);
    if (!(usual > 0) || away[i] <= gap * usual) continue;
    // Poses beside those of the list, such as other moments of an exposure, lie a bit outside.
    region.radius = 3 * usual;
    break;
  }
  return region;
}

}  // namespace jade::geometry
