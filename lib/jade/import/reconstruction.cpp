// SPDX-License-Identifier: Apache-2.0
#include "jade/import/reconstruction.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <utility>

#include "jade/core/median.h"
#include "jade/io/colmap.h"

namespace jade::import {
namespace {

namespace fs = std::filesystem;

double median_depth(const Reconstruction& r) {
  std::vector<double> depths;
  for (size_t i = 0; i < r.seen_by.size(); ++i) {
    for (const int64_t k : r.seen_by[i]) {
      depths.push_back(geometry::transform(r.poses[static_cast<size_t>(k)].pose,
                                           point_at(r.points, static_cast<int64_t>(i)))[2]);
    }
  }
  return median_of(std::move(depths));
}

/// Scales the scene to units of its median depth: COLMAP's scale is arbitrary, and step sizes of
/// learned poses treat rotations and translations alike if depths are about 1.
void set_scale(Reconstruction& r) {
  const double depth = median_depth(r);
  if (!(depth > 0)) return;
  r.points = r.points / depth;
  for (TimedPose& timed : r.poses) {
    for (double& t : timed.pose.translation) t /= depth;
  }
}

double angle_between(const geometry::Vector3& a, const geometry::Vector3& b) {
  double dot = 0, aa = 0, bb = 0;
  for (size_t i = 0; i < 3; ++i) {
    dot += a[i] * b[i];
    aa += a[i] * a[i];
    bb += b[i] * b[i];
  }
  return std::acos(std::clamp(dot / std::sqrt(aa * bb), -1.0, 1.0)) * 180 / M_PI;
}

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

/// Removes images that were registered to another part of a repeating texture: each, the worst
/// first, that is ten times as far from the line between its neighbours in time as is usual, three
/// times as far as they are apart, and sees other points than they do. An image at the turn of a
/// shake is as far off, but sees their points. Few poses do not determine what is usual.
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

}  // namespace

geometry::Vector3 point_at(const torch::Tensor& points, int64_t index) {
  const double* p = points.const_data_ptr<double>() + 3 * index;
  return {p[0], p[1], p[2]};
}

double median_parallax(const Reconstruction& r) {
  std::vector<double> angles;
  for (size_t i = 0; i < r.seen_by.size(); ++i) {
    const geometry::Vector3 x = point_at(r.points, static_cast<int64_t>(i));
    const auto ray = [&](int64_t pose) {
      geometry::Vector3 d = geometry::centre(r.poses[static_cast<size_t>(pose)].pose);
      for (size_t k = 0; k < 3; ++k) d[k] = x[k] - d[k];
      return d;
    };
    double widest = 0;
    for (const int64_t k : r.seen_by[i]) {
      widest = std::max(widest, angle_between(ray(r.seen_by[i].front()), ray(k)));
    }
    angles.push_back(widest);
  }
  return median_of(std::move(angles));
}

PosePath path_of(const std::vector<TimedPose>& poses, const Capture& capture) {
  std::vector<std::pair<double, geometry::Pose>> timed;
  for (const TimedPose& pose : poses) timed.emplace_back(double(pose.t_us), pose.pose);
  int64_t shortest_us = INT64_MAX;
  for (const Shot& shot : capture.shots) {
    if (shot.duration_us() > 0) shortest_us = std::min(shortest_us, shot.duration_us());
  }
  return path_through(std::move(timed), shortest_us == INT64_MAX ? 1 : 0.125 * double(shortest_us));
}

Reconstruction read_reconstruction(const fs::path& model, const std::vector<LatentImage>& images,
                                   double scale) {
  const io::ColmapModel found = io::read_colmap(model);
  std::map<std::string, const LatentImage*> by_file;
  for (const LatentImage& image : images) by_file[image.file] = &image;
  Reconstruction r;
  std::map<int64_t, const LatentImage*> by_id;
  for (const io::ColmapImage& image : found.images) {
    const auto known = by_file.find(image.name);
    if (known == by_file.end()) continue;
    by_id[image.id] = known->second;
    const geometry::Pose pose{geometry::rotation_from_quaternion(image.rotation),
                              image.translation};
    r.poses.push_back({known->second->t_us, known->second->shot, pose, 0});
  }
  if (r.poses.empty()) return r;
  std::sort(r.poses.begin(), r.poses.end(),
            [](const TimedPose& a, const TimedPose& b) { return a.t_us < b.t_us; });
  const auto index_of = [&](int64_t id) {
    const int64_t t = by_id.at(id)->t_us;
    return std::lower_bound(r.poses.begin(), r.poses.end(), t,
                            [](const TimedPose& p, int64_t at) { return p.t_us < at; }) -
           r.poses.begin();
  };
  for (const auto& track : found.point_images) {
    r.seen_by.emplace_back();
    for (const int64_t id : track) {
      if (by_id.count(id) == 0) continue;
      r.seen_by.back().push_back(index_of(id));
      ++r.poses[static_cast<size_t>(r.seen_by.back().back())].observations;
    }
  }
  drop_strays(r);
  const io::ColmapCamera& camera = found.cameras.front();
  const auto whole = [&](int64_t size) { return std::llround(double(size) / scale); };
  r.camera = geometry::Intrinsics::centred(camera.parameters[0] / scale, whole(camera.width),
                                           whole(camera.height));
  r.points = found.points;
  r.colors = found.point_colors;
  r.point_errors = found.point_errors / scale;
  set_scale(r);
  return r;
}

}  // namespace jade::import
