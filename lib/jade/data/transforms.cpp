// SPDX-License-Identifier: Apache-2.0
#include "jade/data/transforms.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/data/colmap_scene.h"
#include "jade/data/frame_times.h"
#include "jade/data/frames.h"
#include "jade/imaging/image_io.h"

namespace jade::data {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

struct ListedView {
  fs::path path;
  geometry::Pose pose;
  geometry::Intrinsics camera;  ///< 0 where the file does not say
  double angle_x = 0;           ///< horizontal field of view in radians, in place of a focal length
  bool fisheye = false;
};

/// With fewer images left of a file that named more, its scene is taken for damaged.
constexpr size_t kFewestFrames = 3;

json read_json(const fs::path& path) {
  const json root = json::parse(read_file(path), nullptr, /*allow_exceptions=*/false);
  if (root.is_object() && root.contains("frames") && root["frames"].is_array()) return root;
  throw DataError(concat(path.string(),
                         ": expected a JSON object with a list 'frames'; the file is "
                         "damaged or of another kind"));
}

double number(const json& object, const std::string& key, double otherwise) {
  return object.contains(key) && object[key].is_number() ? object[key].get<double>() : otherwise;
}

geometry::Pose pose_of_matrix(const json& matrix, const std::string& where) {
  double m[3][4];
  const auto wrong = [&] {
    return DataError(concat(where,
                            ": expected 'transform_matrix' to be a 4x4 rotation and "
                            "translation, world_from_camera in OpenGL axes"));
  };
  if (!matrix.is_array() || matrix.size() < 3) throw wrong();
  for (size_t row = 0; row < 3; ++row) {
    if (!matrix[row].is_array() || matrix[row].size() != 4) throw wrong();
    for (size_t column = 0; column < 4; ++column) {
      if (!matrix[row][column].is_number()) throw wrong();
      m[row][column] = matrix[row][column].get<double>();
      if (!std::isfinite(m[row][column])) throw wrong();
    }
  }
  geometry::Pose world_from_camera;
  for (size_t row = 0; row < 3; ++row) {
    for (size_t column = 0; column < 3; ++column) {
      world_from_camera.rotation[3 * row + column] = column == 0 ? m[row][0] : -m[row][column];
    }
    world_from_camera.translation[row] = m[row][3];
  }
  try {
    world_from_camera.rotation = geometry::nearest_rotation(world_from_camera.rotation);
  } catch (const ContractError&) {
    throw wrong();
  }
  return geometry::inverse(world_from_camera);
}

/// Paths are relative to the JSON and may lack an extension. Empty where there is no such image;
/// its name is then added to `missing`.
fs::path image_of(const fs::path& folder, const json& frame, const std::string& where,
                  std::vector<std::string>& missing) {
  if (!frame.is_object() || !frame.contains("file_path") || !frame["file_path"].is_string()) {
    throw DataError(concat(where, ": expected a 'file_path'"));
  }
  const fs::path given = (folder / frame["file_path"].get<std::string>()).lexically_normal();
  for (const char* extension : {"", ".png", ".jpg", ".jpeg", ".JPG"}) {
    const fs::path path = given.string() + extension;
    if (fs::is_regular_file(path)) return path;
  }
  missing.push_back(frame["file_path"].get<std::string>());
  return {};
}

/// Most scenes lack none; where a few images were dropped, the rest is a scene still.
void tell_missing(const fs::path& path, const std::vector<std::string>& missing, size_t frames,
                  const Warnings& warnings) {
  if (missing.empty()) return;
  const std::string what = concat(path.string(), ": ", missing.size(), " of ", frames,
                                  " frames name an image that is not there: ", listing(missing, 3));
  const size_t left = frames - missing.size();
  if (left < std::min<size_t>(frames, kFewestFrames) || 2 * left < frames) {
    throw DataError(concat(what, "; expected at least half of them and no fewer than ",
                           kFewestFrames, "; is the folder of the images complete?"));
  }
  warnings.add(what, "; they are left out");
}

geometry::Intrinsics camera_of_frame(const json& root, const json& frame,
                                     const std::string& where) {
  const auto value = [&](const char* key, double otherwise) {
    return number(frame, key, number(root, key, otherwise));
  };
  const auto side = [&](const char* key) {
    constexpr double kLargestSide = 1 << 16;
    const double found = value(key, 0);
    if (found >= 0 && found <= kLargestSide) return static_cast<int64_t>(found);
    throw DataError(concat(where, ": expected '", key, "' from 0 to ", kLargestSide, " px, found ",
                           found, "; correct it"));
  };
  geometry::Intrinsics camera;
  camera.width = side("w");
  camera.height = side("h");
  camera.fx = value("fl_x", 0);
  camera.fy = value("fl_y", camera.fx);
  if (camera.fx > 0 && !(camera.fy > 0)) {
    throw DataError(concat(where, ": expected a focal length 'fl_y' above 0, found ", camera.fy,
                           "; correct it"));
  }
  camera.cx = value("cx", 0);
  camera.cy = value("cy", 0);
  return camera;
}

/// Of the whole file, or of a frame.
const char* distortion_of(const json& object) {
  for (const char* key : {"k1", "k2", "k3", "k4", "p1", "p2"}) {
    if (std::abs(number(object, key, 0)) >= 1e-6) return key;
  }
  return nullptr;
}

void tell_distortion(const fs::path& path, const json& root, const Warnings& warnings) {
  const char* key = distortion_of(root);
  for (const json& frame : root["frames"]) {
    if (key == nullptr) key = distortion_of(frame);
  }
  if (key == nullptr) return;
  warnings.add(path.string(), ": lens distortion (", key,
               ") is ignored; undistort the images first if it is more than a pixel");
}

/// nerfstudio's OPENCV_FISHEYE, of the file or of a frame.
bool is_fisheye(const json& root, const json& frame) {
  const json& object = frame.contains("camera_model") ? frame : root;
  return object.contains("camera_model") && object["camera_model"].is_string() &&
         object["camera_model"].get<std::string>().find("FISHEYE") != std::string::npos;
}

std::vector<ListedView> read_views(const fs::path& path, const Warnings& warnings) {
  const json root = read_json(path);
  tell_distortion(path, root, warnings);
  std::vector<ListedView> views;
  std::vector<std::string> missing;
  for (const json& frame : root["frames"]) {
    const std::string where = concat(path.string(), " frame ", views.size() + missing.size());
    ListedView view;
    view.path = image_of(path.parent_path(), frame, where, missing);
    if (view.path.empty()) continue;
    view.camera = camera_of_frame(root, frame, where);
    view.fisheye = is_fisheye(root, frame);
    if (!frame.contains("transform_matrix")) {
      throw DataError(concat(where, ": expected a 'transform_matrix'"));
    }
    view.pose = pose_of_matrix(frame["transform_matrix"], where);
    if (!(view.camera.fx > 0)) {
      view.angle_x = number(root, "camera_angle_x", 0);
      if (!(view.angle_x > 0 && view.angle_x < 3.1)) {
        throw DataError(concat(where, ": expected 'fl_x' or 'camera_angle_x'"));
      }
    }
    views.push_back(std::move(view));
  }
  tell_missing(path, missing, root["frames"].size(), warnings);
  if (views.empty()) throw DataError(concat(path.string(), ": has no frames"));
  return views;
}

geometry::Intrinsics fit_camera(const ListedView& view, int64_t width, int64_t height) {
  if (view.angle_x > 0) {
    const double focal_px = 0.5 * double(width) / std::tan(0.5 * view.angle_x);
    return geometry::Intrinsics::centred(focal_px, width, height);
  }
  geometry::Intrinsics camera = view.camera;
  if (camera.width <= 0 || camera.height <= 0) {
    camera.width = width;
    camera.height = height;
  }
  if (camera.cx == 0) camera.cx = 0.5 * double(camera.width);
  if (camera.cy == 0) camera.cy = 0.5 * double(camera.height);
  return geometry::scaled(camera, width, height);
}

/// A fisheye of so narrow a field that it is a pinhole to a pixel may pass for one.
void check_pinhole(const ListedView& view, const geometry::Intrinsics& camera) {
  if (!view.fisheye) return;
  const double shift = fisheye_shift_px(camera.fx, camera.width, camera.height);
  if (shift <= 1) return;
  throw DataError(concat(view.path.string(), ": its camera_model is a fisheye, which ",
                         std::isfinite(shift) ? concat("bends the corners by ", shift, " px")
                                              : std::string("sees farther than any pinhole"),
                         "; undistort the images first"));
}

}  // namespace

bool is_transforms(const fs::path& folder) {
  return fs::exists(folder / "transforms.json") || fs::exists(folder / "transforms_train.json");
}

std::vector<fs::path> named_folders(const fs::path& folder) {
  std::set<fs::path> folders;
  const Warnings nobody(nullptr);
  for (const char* name : {"transforms.json", "transforms_train.json", "transforms_test.json"}) {
    if (!fs::exists(folder / name)) continue;
    for (const ListedView& view : read_views(folder / name, nobody)) {
      folders.insert(fs::weakly_canonical(fs::absolute(view.path.parent_path())));
    }
  }
  return {folders.begin(), folders.end()};
}

Dataset load_transforms(const DatasetOptions& options, const Warnings& warnings) {
  const fs::path single = options.path / "transforms.json";
  std::vector<ListedView> views;
  std::vector<bool> is_test;
  Dataset data;
  if (fs::exists(single)) {
    views = read_views(single, warnings);
    std::sort(views.begin(), views.end(),
              [](const ListedView& a, const ListedView& b) { return a.path < b.path; });
    Split split = split_by_position(
        views.size(), {options.split, options.test_last, options.test_every}, single.string());
    is_test = std::move(split.is_test);
    data.split = split.rule;
  } else {
    views = read_views(options.path / "transforms_train.json", warnings);
    is_test.assign(views.size(), false);
    const fs::path test = options.path / "transforms_test.json";
    if (fs::exists(test) && options.split != SplitKind::kNone) {
      for (ListedView& view : read_views(test, warnings)) views.push_back(std::move(view));
    }
    is_test.resize(views.size(), true);
    data.split = "transforms_test.json";
  }
  std::vector<fs::path> paths;
  for (const ListedView& view : views) paths.push_back(view.path);
  const std::vector<Frame> frames = read_frames(paths);
  data.root = options.path;
  std::vector<geometry::Pose> poses;
  for (size_t i = 0; i < views.size(); ++i) {
    const geometry::Intrinsics camera =
        fit_camera(views[i], frames[i].image.size(2), frames[i].image.size(1));
    check_pinhole(views[i], camera);
    poses.push_back(views[i].pose);
    if (is_test[i]) {
      data.test.push_back(
          {frames[i].name, frames[i].image, views[i].pose, camera, SharpView::kNoTime});
      continue;
    }
    Exposure exposure;
    exposure.name = frames[i].name;
    exposure.blurry = frames[i].image;
    exposure.poses.fill(views[i].pose);
    exposure.camera = camera;
    data.train.push_back(std::move(exposure));
  }
  const DepthBounds bounds = depth_bounds({}, poses);
  data.near = bounds.near;
  data.far = bounds.far;
  return data;
}

}  // namespace jade::data
