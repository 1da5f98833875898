// SPDX-License-Identifier: Apache-2.0
#include "jade/data/transforms.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>
#include <torch/types.h>
#include <utility>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/data/frame_times.h"
#include "jade/data/frames.h"
#include "jade/data/origin.h"
#include "jade/data/undistorter.h"
#include "jade/geometry/lens.h"
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
  geometry::Lens lens;
};

/// With fewer images left of a file that named more, its scene is taken for damaged.
constexpr size_t kFewestFrames = 3;

/// Python writes numbers that JSON has not; where the first of them is, as "NaN in line 7".
std::string number_beyond_json(const std::string& text) {
  for (const char* word : {"NaN", "Infinity"}) {
    for (size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + 1)) {
      const size_t before = text.find_last_not_of(" \t\r\n-", at == 0 ? 0 : at - 1);
      if (before == std::string::npos || std::string("[:,").find(text[before]) == std::string::npos)
        continue;
      return concat(word, " in line ", 1 + std::count(text.begin(), text.begin() + long(at), '\n'));
    }
  }
  return "";
}

json read_json(const fs::path& path) {
  const std::string text = read_file(path);
  const json root = json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (root.is_discarded()) {
    if (const std::string found = number_beyond_json(text); !found.empty()) {
      throw DataError(concat(path.string(), ": expected finite numbers, found ", found,
                             "; the tool that wrote the file failed there, run it again"));
    }
  }
  if (root.is_object() && root.contains("frames") && root["frames"].is_array()) return root;
  throw DataError(concat(path.string(),
                         ": expected a JSON object with a list 'frames'; the file is "
                         "damaged or of another kind"));
}

/// @throws DataError where the key has something else than a number or null.
double number(const json& object, const std::string& key, double otherwise,
              const std::string& where) {
  if (!object.contains(key) || object[key].is_null()) return otherwise;
  if (object[key].is_number() && std::isfinite(object[key].get<double>())) {
    return object[key].get<double>();
  }
  throw DataError(concat(where, ": expected '", key, "' to be a number, found ",
                         object[key].dump().substr(0, 40), "; correct it"));
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
    return number(frame, key, number(root, key, otherwise, where), where);
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

/// Keys of cameras that no pinhole can replace, with what they are.
constexpr std::pair<const char*, const char*> kUnlikePinholes[] = {
    {"ftheta_p0", "an f-theta lens"}, {"latlong", "a picture of all around"}};

/// The value of a key, of the frame or else of the file; empty where neither has it.
std::string text_value(const json& root, const json& frame, const char* key) {
  const json& object = frame.contains(key) ? frame : root;
  return object.contains(key) && object[key].is_string() ? object[key].get<std::string>() : "";
}

bool flag(const json& root, const json& frame, const char* key) {
  const json& object = frame.contains(key) ? frame : root;
  return object.contains(key) && object[key].is_boolean() && object[key].get<bool>();
}

DataError unlike_pinhole(const std::string& where, const std::string& what) {
  return DataError(concat(where, ": expected a camera that a pinhole can replace, found ", what,
                          "; undistort the images first"));
}

/// nerfstudio's camera_model with k1 to k6, p1 and p2, or instant-ngp's is_fisheye.
geometry::Lens lens_of_frame(const json& root, const json& frame, const std::string& where) {
  using geometry::LensModel;
  std::string model = text_value(root, frame, "camera_model");
  std::transform(model.begin(), model.end(), model.begin(),
                 [](unsigned char letter) { return char(std::toupper(letter)); });
  static const std::set<std::string> perspectives = {
      "",       "SIMPLE_PINHOLE", "PINHOLE",     "SIMPLE_RADIAL",
      "RADIAL", "OPENCV",         "FULL_OPENCV", "PERSPECTIVE"};
  static const std::set<std::string> fisheyes = {"OPENCV_FISHEYE", "SIMPLE_RADIAL_FISHEYE",
                                                 "RADIAL_FISHEYE", "SIMPLE_FISHEYE", "FISHEYE"};
  if (perspectives.count(model) + fisheyes.count(model) == 0) {
    throw unlike_pinhole(where, concat("camera_model ", model));
  }
  for (const auto& [key, what] : kUnlikePinholes) {
    if (root.contains(key) || frame.contains(key)) throw unlike_pinhole(where, what);
  }
  const auto value = [&](const char* key) {
    return number(frame, key, number(root, key, 0, where), where);
  };
  geometry::Lens lens{LensModel::kPinhole, value("k1"), value("k2"),
                      value("p1"),         value("p2"), value("k3"),
                      value("k4"),         0,           0};
  if (fisheyes.count(model) > 0 || flag(root, frame, "is_fisheye")) {
    lens.model = LensModel::kFisheye;
    lens.p1 = lens.p2 = 0;
    return lens;
  }
  if (model == "PINHOLE" || model == "SIMPLE_PINHOLE") return {};
  if (model == "FULL_OPENCV") {
    lens.k5 = value("k5");
    lens.k6 = value("k6");
    lens.model = LensModel::kRational;
    return lens;
  }
  if (std::abs(lens.k4) >= 1e-6) {
    throw unlike_pinhole(where, concat("a fourth radial coefficient k4 of ", lens.k4));
  }
  lens.k4 = 0;
  lens.model = LensModel::kRadialTangential;
  return lens;
}

std::vector<ListedView> read_views(const fs::path& path, const Warnings& warnings) {
  const json root = read_json(path);
  std::vector<ListedView> views;
  std::vector<std::string> missing;
  for (const json& frame : root["frames"]) {
    const std::string where = concat(path.string(), " frame ", views.size() + missing.size());
    ListedView view;
    view.path = image_of(path.parent_path(), frame, where, missing);
    if (view.path.empty()) continue;
    view.camera = camera_of_frame(root, frame, where);
    view.lens = lens_of_frame(root, frame, where);
    if (!frame.contains("transform_matrix")) {
      throw DataError(concat(where, ": expected a 'transform_matrix'"));
    }
    view.pose = pose_of_matrix(frame["transform_matrix"], where);
    if (!(view.camera.fx > 0)) {
      view.angle_x =
          number(frame, "camera_angle_x", number(root, "camera_angle_x", 0, where), where);
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

geometry::LensCamera fit_camera(const ListedView& view, int64_t width, int64_t height) {
  geometry::Intrinsics camera = view.camera;
  if (camera.width <= 0 || camera.height <= 0) {
    camera.width = width;
    camera.height = height;
  }
  if (view.angle_x > 0) {
    camera = geometry::Intrinsics::centred(
        0.5 * double(camera.width) / std::tan(0.5 * view.angle_x), camera.width, camera.height);
  }
  if (camera.cx == 0) camera.cx = 0.5 * double(camera.width);
  if (camera.cy == 0) camera.cy = 0.5 * double(camera.height);
  return {fit_to_picture(camera, width, height, view.path.string()), view.lens};
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
  const std::vector<Frame> frames = read_frames(paths, FrameSizes::kAny);
  data.root = options.path;
  std::vector<geometry::Pose> poses;
  for (const ListedView& view : views) poses.push_back(view.pose);
  data.origin = origin_of(poses, {});
  for (size_t i = 0; i < views.size(); ++i) {
    views[i].pose = poses[i] = geometry::with_origin(poses[i], data.origin);
  }
  Undistorter undistorter;
  for (size_t i = 0; i < views.size(); ++i) {
    torch::Tensor image = frames[i].image, mask;
    const geometry::Intrinsics camera = undistorter.undistort(
        fit_camera(views[i], image.size(2), image.size(1)), options.path.string(), image, mask);
    if (is_test[i]) {
      data.test.push_back({frames[i].name, image, views[i].pose, camera, SharpView::kNoTime});
      data.test.back().mask = mask;
      continue;
    }
    Exposure exposure;
    exposure.name = frames[i].name;
    exposure.blurry = image;
    exposure.poses.fill(views[i].pose);
    exposure.camera = camera;
    exposure.mask = mask;
    data.train.push_back(std::move(exposure));
  }
  undistorter.tell(warnings, data.notes);
  const DepthBounds bounds = depth_bounds({}, poses);
  data.near = bounds.near;
  data.far = bounds.far;
  return data;
}

}  // namespace jade::data
