// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/init.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <cmath>

#include "jade/core/check.h"
#include "jade/core/log.h"
#include "jade/core/readable.h"
#include "jade/gaussians/neighbours.h"
#include "jade/gaussians/plane_sweep.h"
#include "jade/gaussians/scene_file.h"
#include "jade/splat/math/sh.h"

namespace jade::gaussians {
namespace {

using geometry::Vector3;

constexpr int kNeighbours = 3;
constexpr int64_t kFewestSfmPoints = 100;
/// Far over near above which depths are a guess: loaders that know none assume 10,000.
constexpr double kWideDepths = 1000;
/// SfM points nearer to a camera than this share of the extent would fill its image.
constexpr double kNearCamera = 1e-3;

double distance(const Vector3& a, const Vector3& b) {
  return std::sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) +
                   (a[2] - b[2]) * (a[2] - b[2]));
}

/// Rows with finite coordinates.
PointCloud finite_points(const PointCloud& cloud) {
  const torch::Tensor rows = cloud.points.isfinite().all(1).nonzero().squeeze(1);
  return {cloud.points.index_select(0, rows), cloud.colors.index_select(0, rows)};
}

/// Adds the view's colour, without its gain, at the projections of the points it sees.
void add_colors(const InitView& view, const torch::Tensor& points, torch::Tensor& sums,
                torch::Tensor& counts) {
  const torch::Tensor image = view.image.detach().to(torch::kCPU, torch::kFloat32).contiguous();
  const int64_t height = image.size(1), width = image.size(2);
  const float* pixels = image.const_data_ptr<float>();
  const torch::Tensor mask =
      view.mask.defined() ? view.mask.to(torch::kCPU).contiguous() : torch::Tensor();
  const bool* counted = mask.defined() ? mask.const_data_ptr<bool>() : nullptr;
  const auto gain = static_cast<float>(view.gain);
  const float* point = points.const_data_ptr<float>();
  auto* sum = sums.mutable_data_ptr<float>();
  auto* count = counts.mutable_data_ptr<float>();
  at::parallel_for(0, points.size(0), 1024, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      const Vector3 x = geometry::transform(view.camera_from_world,
                                            {point[3 * i], point[3 * i + 1], point[3 * i + 2]});
      if (!(x[2] > 0)) continue;
      const auto uv = geometry::project(view.camera, x);
      if (!(uv[0] >= 0 && uv[1] >= 0 && uv[0] < static_cast<double>(width) &&
            uv[1] < static_cast<double>(height))) {
        continue;
      }
      const int64_t at = static_cast<int64_t>(uv[1]) * width + static_cast<int64_t>(uv[0]);
      if (counted != nullptr && !counted[at]) continue;
      for (int64_t c = 0; c < 3; ++c) sum[3 * i + c] += pixels[c * height * width + at] / gain;
      count[i] += 1;
    }
  });
}

std::vector<geometry::Pose> poses_of(const std::vector<InitView>& views) {
  std::vector<geometry::Pose> poses;
  for (const InitView& view : views) poses.push_back(view.camera_from_world);
  return poses;
}

PointCloud sfm_points(const InitSources& sources) {
  const auto poses = poses_of(sources.views);
  return without_points_near_cameras(finite_points(sources.points), poses,
                                     kNearCamera * scene_extent(poses));
}

/// A random subset if there are too many points.
PointCloud drawn_points(const PointCloud& cloud, int64_t at_most, at::Generator& generator) {
  const int64_t count = cloud.points.size(0);
  if (count <= at_most) return cloud;
  log_info(concat("start       ", grouped(at_most), " of ", grouped(count),
                  " points, as densify.max_gaussians says"));
  const torch::Tensor rows =
      std::get<0>(at::randperm(count, generator).narrow(0, 0, at_most).sort());
  return {cloud.points.index_select(0, rows), cloud.colors.index_select(0, rows)};
}

/// Points of a file, relative to the origin of the data set.
torch::Tensor with_origin(const torch::Tensor& points, const Vector3& from, const Vector3& to) {
  if (from == to) return points;
  const torch::Tensor shift =
      torch::tensor({from[0] - to[0], from[1] - to[1], from[2] - to[2]}, torch::kFloat64);
  return (points.to(torch::kFloat64) + shift).to(torch::kFloat32);
}

/// Points at the same place get this squared size, so that its logarithm is finite. 1e-7 is the
/// published value; in a scene of small units it would enlarge most Gaussians.
double least_spread(const torch::Tensor& spread) {
  const double usual = spread.numel() > 0 ? spread.median().item<double>() : 0;
  return usual > 0 ? std::min(1e-7, 1e-3 * usual) : 1e-7;
}

}  // namespace

double scene_extent(const std::vector<geometry::Pose>& cameras_from_world) {
  Vector3 mean{0, 0, 0};
  for (const auto& pose : cameras_from_world) {
    const Vector3 c = geometry::centre(pose);
    for (size_t a = 0; a < 3; ++a) mean[a] += c[a] / static_cast<double>(cameras_from_world.size());
  }
  double radius = 0;
  for (const auto& pose : cameras_from_world) {
    radius = std::max(radius, distance(geometry::centre(pose), mean));
  }
  return radius > 0 ? 1.1 * radius : 1;
}

torch::Tensor mean_squared_neighbour_distance(const torch::Tensor& points) {
  const torch::Tensor plain = points.detach().to(torch::kCPU, torch::kFloat32).contiguous();
  check_shape(plain, "points", {-1, 3});
  const float* data = plain.const_data_ptr<float>();
  std::vector<PointTree::Point> list(static_cast<size_t>(plain.size(0)));
  for (size_t i = 0; i < list.size(); ++i)
    list[i] = {data[3 * i], data[3 * i + 1], data[3 * i + 2]};
  const PointTree tree(std::move(list));
  torch::Tensor result = torch::empty({plain.size(0)}, torch::kFloat32);
  auto* out = result.mutable_data_ptr<float>();
  at::parallel_for(0, plain.size(0), 512, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      out[i] = static_cast<float>(tree.mean_squared_distance(i, kNeighbours));
    }
  });
  return result;
}

splat::Gaussians gaussians_from_points(const PointCloud& cloud) {
  const int64_t count = cloud.points.size(0);
  check_shape(cloud.points, "points", {-1, 3});
  check_shape(cloud.colors, "point colours", {count, 3});
  splat::Gaussians g;
  g.means = cloud.points.to(torch::kFloat32).contiguous();
  torch::Tensor spread = mean_squared_neighbour_distance(g.means);
  spread = spread.clamp_min(least_spread(spread));
  g.log_scales = (0.5 * spread.log()).unsqueeze(1).repeat({1, 3}).contiguous();
  g.rotations = torch::zeros({count, 4});
  g.rotations.select(1, 0).fill_(1);
  g.logit_opacities = torch::full({count}, std::log(kStartOpacity / (1 - kStartOpacity)));
  g.sh = torch::zeros({count, 16, 3});
  g.sh.select(1, 0).copy_((cloud.colors - 0.5) / splat::math::kSh0);
  return g;
}

void check_frusta(const InitSources& sources) {
  JADE_CHECK(!sources.views.empty(), "sampled points: expected at least one view");
  JADE_CHECK(sources.near > 0 && sources.far > sources.near,
             "sampled points: expected 0 < near < far, found ", sources.near, " and ", sources.far);
}

Vector3 point_in_frustum(const InitSources& sources, const Vector3& draw, double share) {
  const InitView& view =
      sources.views[static_cast<size_t>(draw[0] * static_cast<double>(sources.views.size()))];
  const double inverse = 1 / sources.far + share * (1 / sources.near - 1 / sources.far);
  const Vector3 ray =
      geometry::unproject(view.camera, draw[1] * static_cast<double>(view.camera.width),
                          draw[2] * static_cast<double>(view.camera.height));
  return geometry::transform(geometry::inverse(view.camera_from_world),
                             {ray[0] / inverse, ray[1] / inverse, ray[2] / inverse});
}

PointCloud random_frusta(const InitSources& sources, int64_t count, at::Generator& generator) {
  check_frusta(sources);
  const torch::Tensor draws = at::rand({count, 4}, generator, torch::kFloat64);
  const double* draw = draws.const_data_ptr<double>();
  PointCloud cloud;
  cloud.points = torch::empty({count, 3}, torch::kFloat32);
  auto* point = cloud.points.mutable_data_ptr<float>();
  for (int64_t i = 0; i < count; ++i, draw += 4) {
    const Vector3 world = point_in_frustum(sources, {draw[0], draw[1], draw[2]}, draw[3]);
    for (size_t a = 0; a < 3; ++a)
      point[3 * i + static_cast<int64_t>(a)] = static_cast<float>(world[a]);
  }
  cloud.colors = torch::zeros({count, 3});
  torch::Tensor seen = torch::zeros({count});
  for (const InitView& view : sources.views) add_colors(view, cloud.points, cloud.colors, seen);
  cloud.colors.div_(seen.clamp_min(1).unsqueeze(1));
  return cloud;
}

std::string depth_fault(const InitSources& sources) {
  if (!(sources.far > kWideDepths * sources.near)) return "";
  return concat("start points: expected points or known depths, found none, so Gaussians start ",
                "anywhere between depths ", sources.near, " and ", sources.far,
                ", few of them where the scene is; set init.kind to plane_sweep, which finds the ",
                "depths at which the views agree, or add points");
}

PointCloud without_points_near_cameras(const PointCloud& cloud,
                                       const std::vector<geometry::Pose>& cameras_from_world,
                                       double distance) {
  torch::Tensor keep = torch::ones({cloud.points.size(0)}, torch::kBool);
  for (const auto& pose : cameras_from_world) {
    const Vector3 c = geometry::centre(pose);
    const torch::Tensor centre = torch::tensor({c[0], c[1], c[2]}, torch::kFloat64);
    keep = keep & ((cloud.points.to(torch::kFloat64) - centre).norm(2, 1) > distance);
  }
  const torch::Tensor rows = keep.nonzero().squeeze(1);
  return {cloud.points.index_select(0, rows), cloud.colors.index_select(0, rows)};
}

splat::Gaussians initial_gaussians(const InitOptions& options, const InitSources& sources,
                                   at::Generator& generator, int64_t at_most) {
  const auto start_at = [&](const PointCloud& cloud) {
    return gaussians_from_points(drawn_points(cloud, at_most, generator));
  };
  const int64_t found = sources.points.points.defined() ? sources.points.points.size(0) : 0;
  if (options.kind == InitKind::kPly) {
    if (options.ply.empty()) {
      throw ConfigError("init.kind is ply but init.ply names no file");
    }
    if (scene_kind(options.ply).value_or(SceneKind::kPly) == SceneKind::kPly &&
        !has_gaussians(options.ply)) {
      PointCloud cloud = read_point_cloud(options.ply);
      cloud.points = with_origin(cloud.points, cloud.origin, sources.origin);
      return start_at(finite_points(cloud));
    }
    const GaussianFile file = read_gaussians(options.ply);
    splat::Gaussians scene = file.gaussians;
    scene.means = with_origin(scene.means, file.origin, sources.origin);
    check_some(scene, options.ply);
    if (scene.size() > at_most) {
      log_warn(concat(options.ply.string(), ": ", scene.size(),
                      " Gaussians, more than densify.max_gaussians ", at_most,
                      ": none will be added; raise it to let the scene grow"));
    }
    return scene;
  }
  if (options.kind == InitKind::kSfm && found == 0) {
    throw ConfigError("init.kind is sfm but the data set has no points: use auto");
  }
  const bool prefers_sfm =
      options.kind == InitKind::kAuto || options.kind == InitKind::kSfmOrRandom;
  if (options.kind == InitKind::kSfm || (prefers_sfm && found >= kFewestSfmPoints)) {
    return start_at(sfm_points(sources));
  }
  if (prefers_sfm && found > 0) {
    log_warn(concat("start points: expected at least ", kFewestSfmPoints, ", found ", found,
                    "; the start is sought without them, unless init.kind is sfm"));
  }
  if (!(sources.near > 0 && sources.far > sources.near)) {
    throw ConfigError(concat("init.kind ", word_of(options.kind),
                             " needs depth bounds 0 < near < far, found ", sources.near, " and ",
                             sources.far));
  }
  const int64_t count = std::min(options.points, at_most);
  const bool sweep = options.kind == InitKind::kAuto || options.kind == InitKind::kPlaneSweep;
  if (!sweep) {
    const std::string fault = depth_fault(sources);
    if (prefers_sfm && !fault.empty()) log_warn(fault);
    return start_at(random_frusta(sources, count, generator));
  }
  double disagreement = 0;
  const PointCloud cloud = plane_sweep(sources, count, generator, &disagreement);
  if (const std::string fault = pose_fault(disagreement); !fault.empty()) log_warn(fault);
  return start_at(cloud);
}

}  // namespace jade::gaussians
