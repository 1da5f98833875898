// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <ATen/core/Generator.h>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <torch/types.h>
#include <vector>

#include "jade/core/fields.h"
#include "jade/gaussians/ply.h"
#include "jade/geometry/camera.h"
#include "jade/geometry/pose.h"
#include "jade/splat/gaussians.h"

namespace jade::gaussians {

/// Source of the initial Gaussians.
enum class InitKind { kAuto, kSfm, kPlaneSweep, kRandomFrusta, kSfmOrRandom, kPly };

constexpr auto words_of(InitKind) {
  return std::array{
      Word{"auto", InitKind::kAuto, "sfm if there are points, else plane_sweep"},
      Word{"sfm", InitKind::kSfm, "points of the data set"},
      Word{"plane_sweep", InitKind::kPlaneSweep,
           "sampled in the viewing frusta, at the depths where the views agree best"},
      Word{"random_frusta", InitKind::kRandomFrusta,
           "sampled in the viewing frusta, at random depths"},
      Word{"sfm_or_random", InitKind::kSfmOrRandom, "sfm if there are points, else random_frusta"},
      Word{"ply", InitKind::kPly, "init.ply"}};
}

struct InitOptions {
  InitKind kind = InitKind::kAuto;
  std::filesystem::path ply;
  int64_t points = 20000;
};

/// Initial opacity of a Gaussian at a point, as in 3DGS.
constexpr double kStartOpacity = 0.1;

template <class V>
void describe(V& v, InitOptions& o) {
  v.field("kind", o.kind, "source of the initial Gaussians");
  v.field("ply", o.ply,
          "Gaussians (.ply, .spz, .sog, .glb, .gltf or .splat) or coloured points (.ply) to start "
          "from (kind ply)");
  v.field("points", o.points, "number of points for plane_sweep and random_frusta", Range{1, 1e8});
  v.fixed("opacity", kStartOpacity);
  v.fixed("scale", 1);
}

/// A view used to initialise colours and bounds.
struct InitView {
  geometry::Pose camera_from_world;
  geometry::Intrinsics camera;
  torch::Tensor image;  ///< [3,H,W]
  torch::Tensor mask;   ///< [1,H,W] bool, true: the pixel counts; undefined: all pixels count
  double gain = 1;      ///< frame brightness = scene brightness · gain
};

/// Data available to the initialisation.
struct InitSources {
  std::vector<InitView> views;
  double near = 0, far = 0;  ///< depth range of sampled points, world units
  PointCloud points;         ///< SfM points; tensors may be undefined
  /// Origin of views and points in the data set's own coordinates, which init.ply uses.
  geometry::Vector3 origin{0, 0, 0};
};

/// 1.1 × the largest distance of a camera centre from the mean of all; 1 for a single centre.
double scene_extent(const std::vector<geometry::Pose>& cameras_from_world);

/// [P] mean squared distance of every point to its 3 nearest others (fewer if there are fewer; 0
/// for a single point). Uses a k-d tree, which distant outliers do not slow down. CPU.
torch::Tensor mean_squared_neighbour_distance(const torch::Tensor& points);

/// Creates Gaussians at the points: base colour from the colours, scale sqrt(mean squared distance
/// to the 3 nearest, at least 1e-7, or less in a scene of small units), identity rotation, opacity
/// kStartOpacity, SH degree 3 with zeros beyond degree 0.
splat::Gaussians gaussians_from_points(const PointCloud& cloud);

/// @throws Error unless there are views and 0 < near < far.
void check_frusta(const InitSources& sources);

/// A point in the frustum of a view, world units.
/// @param draw   view, column and row as shares of their numbers, in [0,1)
/// @param share  inverse depth: 0 far, 1 near
geometry::Vector3 point_in_frustum(const InitSources& sources, const geometry::Vector3& draw,
                                   double share);

/// Samples points uniformly over the views and their pixels and uniformly in inverse depth between
/// near and far; their colour is the mean over the views that see them,
/// without masked pixels and gains.
PointCloud random_frusta(const InitSources& sources, int64_t count, at::Generator& generator);

/// That random depths are a bad start, as the bounds of depth are only a guess; else empty.
std::string depth_fault(const InitSources& sources);

/// Removes points within `distance` of a camera centre, which would fill the image.
PointCloud without_points_near_cameras(const PointCloud& cloud,
                                       const std::vector<geometry::Pose>& cameras_from_world,
                                       double distance);

/// The initial Gaussians that `options` select.
/// @param at_most  if there are more points, a random subset is used; the Gaussians of a .ply,
///   which are a complete scene, all stay, with a warning
/// @throws ConfigError if the sources lack what the kind needs, DataError for a bad .ply.
splat::Gaussians initial_gaussians(const InitOptions& options, const InitSources& sources,
                                   at::Generator& generator,
                                   int64_t at_most = std::numeric_limits<int64_t>::max());

}  // namespace jade::gaussians
