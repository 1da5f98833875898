// SPDX-License-Identifier: Apache-2.0
#include "jade/import/stray_images.h"

#include <algorithm>
#include <cmath>

#include "jade/core/median.h"

namespace jade::import {
namespace {

/// On a shaking path images share 0.5 to 0.9 of their points with their neighbours.
constexpr double kLeastShared = 0.25;

double distance_between(const geometry::Vector3& a, const geometry::Vector3& b) {
  double sum = 0;
  for (size_t i = 0; i < 3; ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return std::sqrt(sum);
}

/// Share of the points that pose `i` sees and a neighbour in time sees too.
double shared_points(const Reconstruction& r, size_t i) {
  int64_t own = 0, shared = 0;
  for (const std::vector<int64_t>& seen : r.seen_by) {
    const auto sees = [&](size_t pose) {
      return std::find(seen.begin(), seen.end(), static_cast<int64_t>(pose)) != seen.end();
    };
    if (!sees(i)) continue;
    ++own;
    shared += sees(i - 1) || sees(i + 1) ? 1 : 0;
  }
  return own > 0 ? double(shared) / double(own) : 0;
}

void remove_pose(Reconstruction& r, size_t i) {
  r.poses.erase(r.poses.begin() + static_cast<std::ptrdiff_t>(i));
  const auto gone = static_cast<int64_t>(i);
  for (std::vector<int64_t>& seen : r.seen_by) {
    seen.erase(std::remove(seen.begin(), seen.end(), gone), seen.end());
    for (int64_t& pose : seen) pose -= pose > gone ? 1 : 0;
  }
}

}  // namespace

void drop_strays(Reconstruction& r) {
  constexpr size_t kFew = 8;
  while (r.poses.size() > kFew) {
    const std::vector<TimedPose>& poses = r.poses;
    std::vector<double> off{0}, steps;
    for (size_t i = 0; i + 1 < poses.size(); ++i) {
      const geometry::Vector3 here = geometry::centre(poses[i].pose);
      const geometry::Vector3 after = geometry::centre(poses[i + 1].pose);
      steps.push_back(distance_between(here, after));
      if (i == 0) continue;
      const geometry::Vector3 before = geometry::centre(poses[i - 1].pose);
      const double span = double(poses[i + 1].t_us - poses[i - 1].t_us);
      const double part = span > 0 ? double(poses[i].t_us - poses[i - 1].t_us) / span : 0.5;
      geometry::Vector3 between{};
      for (size_t k = 0; k < 3; ++k) between[k] = before[k] + part * (after[k] - before[k]);
      off.push_back(distance_between(here, between));
    }
    const double limit = std::max(10 * median_of(off), 3 * median_of(steps));
    size_t worst = 0;
    for (size_t i = 1; i < off.size(); ++i) {
      if (off[i] > std::max(limit, off[worst]) && shared_points(r, i) < kLeastShared) worst = i;
    }
    if (worst == 0) return;
    remove_pose(r, worst);
  }
}

}  // namespace jade::import
