// SPDX-License-Identifier: Apache-2.0
#include "jade/data/colmap_scene.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/data/frame_times.h"
#include "jade/data/frames.h"

namespace jade::data {
namespace {

namespace fs = std::filesystem;

/// How far, in pixels, a camera's distortion moves a corner of its image; polynomial models and
/// fisheyes only.
double corner_shift_px(const io::ColmapCamera& camera, double focal_px, size_t first) {
  const double r2 = 0.25 *
                    (double(camera.width) * double(camera.width) +
                     double(camera.height) * double(camera.height)) /
                    (focal_px * focal_px);
  double shift = 0;
  for (size_t i = first; i < camera.parameters.size(); ++i) {
    shift += std::abs(camera.parameters[i]) * r2;
  }
  shift *= std::sqrt(r2) * focal_px;
  // Without any coefficient a fisheye is no pinhole.
  const bool fisheye = camera.model.find("FISHEYE") != std::string::npos;
  return fisheye ? shift + fisheye_shift_px(focal_px, camera.width, camera.height) : shift;
}

fs::path image_path(const fs::path& folder, const std::string& name) {
  const fs::path direct = folder / name;
  return fs::exists(direct) ? direct : folder / fs::path(name).filename();
}

}  // namespace

fs::path find_colmap_model(const fs::path& folder) {
  for (const char* place : {"sparse/0", "sparse", "colmap/sparse/0", "."}) {
    if (io::is_colmap_model(folder / place)) return (folder / place).lexically_normal();
  }
  return {};
}

double fisheye_shift_px(double focal_px, int64_t width, int64_t height) {
  constexpr double kRightAngle = 1.5707963267948966;
  const double radius = 0.5 * std::hypot(double(width), double(height));
  const double angle = radius / focal_px;
  if (!(angle < kRightAngle)) return std::numeric_limits<double>::infinity();
  return focal_px * std::tan(angle) - radius;
}

geometry::Pose pose_of(const io::ColmapImage& image) {
  return {geometry::rotation_from_quaternion(image.rotation), image.translation};
}

geometry::Intrinsics camera_of(const io::ColmapCamera& camera, int64_t width, int64_t height,
                               const Warnings& warnings) {
  const bool two_focals = camera.model != "SIMPLE_PINHOLE" && camera.model != "SIMPLE_RADIAL" &&
                          camera.model != "RADIAL" && camera.model != "SIMPLE_RADIAL_FISHEYE" &&
                          camera.model != "RADIAL_FISHEYE";
  const std::vector<double>& p = camera.parameters;
  geometry::Intrinsics found;
  found.fx = p[0];
  found.fy = two_focals ? p[1] : p[0];
  found.cx = p[two_focals ? 2 : 1];
  found.cy = p[two_focals ? 3 : 2];
  found.width = camera.width;
  found.height = camera.height;
  if (!(found.fy > 0))
    throw DataError(concat("COLMAP camera ", camera.id, ": focal length ", found.fy));
  const double shift = corner_shift_px(camera, found.fx, two_focals ? 4 : 3);
  if (shift > 1) {
    throw DataError(concat("COLMAP camera ", camera.id, " (", camera.model, ") ",
                           std::isfinite(shift) ? concat("bends the corners by ", shift, " px")
                                                : std::string("sees farther than any pinhole"),
                           "; undistort the images first: colmap image_undistorter"));
  }
  if (shift > 0) {
    warnings.add("COLMAP camera ", camera.id, " (", camera.model, "): its distortion of ", shift,
                 " px at the corners is ignored");
  }
  return geometry::scaled(found, width, height);
}

void set_points(const io::ColmapModel& model, Dataset& data) {
  if (!model.points.defined() || model.points.size(0) == 0) return;
  std::vector<double> centres;
  for (const Exposure& exposure : data.train) {
    for (const double value : geometry::centre(exposure.poses[geometry::kMidPose])) {
      centres.push_back(value);
    }
  }
  const torch::Tensor cameras = torch::tensor(centres, torch::kFloat64).reshape({-1, 3});
  torch::Tensor keep = torch::ones({model.points.size(0)}, torch::kBool);
  for (int64_t i = 0; i < cameras.size(0); ++i) {
    keep &= (model.points - cameras[i]).abs().amax(1) > 1e-6;
  }
  data.points = model.points.index({keep}).to(torch::kFloat32);
  data.point_colors = model.point_colors.index({keep}).to(torch::kFloat32) / 255;
}

Dataset load_colmap(const DatasetOptions& options, const Warnings& warnings) {
  const fs::path folder = find_colmap_model(options.path);
  if (folder.empty()) {
    throw DataError(concat(options.path.string(),
                           ": expected a COLMAP model (sparse/0 with cameras and images, .bin or "
                           ".txt), found none"));
  }
  io::ColmapModel model = io::read_colmap(folder);
  if (model.images.empty()) {
    throw DataError(concat(folder.string(),
                           ": expected images with poses, found none; copy the model again or "
                           "rerun COLMAP"));
  }
  std::sort(model.images.begin(), model.images.end(),
            [](const io::ColmapImage& a, const io::ColmapImage& b) { return a.name < b.name; });
  const fs::path image_folder = find_image_folder(options.path, options.image_folder);
  std::vector<fs::path> paths;
  std::vector<const io::ColmapImage*> views;
  std::vector<std::string> missing;
  for (const io::ColmapImage& image : model.images) {
    const fs::path path = image_path(image_folder, image.name);
    if (!fs::exists(path)) {
      missing.push_back(image.name);
      continue;
    }
    paths.push_back(path);
    views.push_back(&image);
  }
  if (paths.empty()) {
    throw DataError(concat(image_folder.string(), ": holds none of the ", model.images.size(),
                           " images of ", folder.string(), "; set dataset.image_folder"));
  }
  if (!missing.empty()) {
    warnings.add(image_folder.string(), ": images of the model without a file: ", listing(missing));
  }
  const std::vector<Frame> frames = read_frames(paths);
  const Split split = split_by_position(
      frames.size(), {options.split, options.test_last, options.test_every}, folder.string());

  Dataset data;
  data.root = options.path;
  data.split = split.rule;
  std::vector<geometry::Pose> poses;
  const int64_t height = frames.front().image.size(1);
  const int64_t width = frames.front().image.size(2);
  for (size_t i = 0; i < frames.size(); ++i) {
    const geometry::Pose pose = pose_of(*views[i]);
    const geometry::Intrinsics camera = camera_of(model.camera(views[i]->camera_id), width, height,
                                                  i == 0 ? warnings : Warnings(nullptr));
    poses.push_back(pose);
    if (split.is_test[i]) {
      data.test.push_back({frames[i].name, frames[i].image, pose, camera, SharpView::kNoTime});
    } else {
      Exposure exposure;
      exposure.name = frames[i].name;
      exposure.blurry = frames[i].image;
      exposure.poses.fill(pose);
      exposure.camera = camera;
      data.train.push_back(std::move(exposure));
    }
  }
  set_points(model, data);
  const DepthBounds bounds = depth_bounds(data.points, poses);
  data.near = bounds.near;
  data.far = bounds.far;
  return data;
}

}  // namespace jade::data
