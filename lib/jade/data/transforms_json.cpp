// SPDX-License-Identifier: Apache-2.0
#include "jade/data/transforms_json.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <initializer_list>
#include <utility>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/data/pose_matrix.h"
#include "jade/io/stand_in.h"

namespace jade::data {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

/// Python writes numbers that JSON does not allow; returns the first of them and its line, as "NaN
/// in line 7".
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

/// @throws DataError if the key's value is neither a number nor null.
double number(const json& object, const std::string& key, double otherwise,
              const std::string& where) {
  if (!object.contains(key) || object[key].is_null()) return otherwise;
  if (object[key].is_number() && std::isfinite(object[key].get<double>())) {
    return object[key].get<double>();
  }
  throw DataError(concat(where, ": expected '", key, "' to be a number, found ",
                         object[key].dump().substr(0, 40), "; correct it"));
}

/// Keys of cameras that no pinhole can replace, with a description.
constexpr std::pair<const char*, const char*> kUnlikePinholes[] = {
    {"ftheta_p0", "an f-theta lens"}, {"latlong", "a picture of all around"}};

/// Whether an object has one of the keys as a number other than 0.
bool states_any(const json& object, std::initializer_list<const char*> keys) {
  return std::any_of(keys.begin(), keys.end(), [&](const char* key) {
    return object.contains(key) && object[key].is_number() && object[key] != 0;
  });
}

bool states_focal_length(const json& object) { return states_any(object, {"fl_x", "fl_y"}); }

bool states_angle(const json& object) {
  return states_any(object, {"camera_angle_x", "camera_angle_y", "x_fov", "y_fov"});
}

/// The value of a key, of the frame or else of the file; empty if neither has it.
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

bool has_coefficients(const geometry::Lens& lens) {
  return lens.k1 != 0 || lens.k2 != 0 || lens.p1 != 0 || lens.p2 != 0 || lens.k3 != 0 ||
         lens.k4 != 0;
}

/// Keys that the entries of nerfstudio's distortion_params correspond to, in order.
constexpr const char* kListedCoefficients[] = {"k1", "k2", "k3", "k4", "p1", "p2"};

/// The coefficients k1 to k6, p1 and p2 that apply to a frame. A list distortion_params overrides
/// single keys, as in nerfstudio; those of a frame override those of the file.
/// @throws DataError unless the list has 6 numbers.
json coefficients_of(const json& root, const json& frame, const std::string& where) {
  json found = json::object();
  for (const json* object : {&root, &frame}) {
    for (const char* key : {"k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"}) {
      if (object->contains(key) && !(*object)[key].is_null()) found[key] = (*object)[key];
    }
    if (!object->contains("distortion_params") || (*object)["distortion_params"].is_null()) {
      continue;
    }
    const json& list = (*object)["distortion_params"];
    if (!list.is_array() || list.size() != std::size(kListedCoefficients)) {
      throw DataError(concat(where,
                             ": expected 'distortion_params' to be the 6 numbers k1, k2, k3, k4, "
                             "p1, p2, found ",
                             list.dump().substr(0, 80), "; correct it"));
    }
    for (size_t i = 0; i < list.size(); ++i) found[kListedCoefficients[i]] = list[i];
  }
  return found;
}

/// Whether a value differs from the default of its key.
bool says_something(const std::string& key, const json& value) {
  if (value.is_null() || value == false || value == "") return false;
  if (value.is_number()) return value.get<double>() != (key == "scale" ? 1.0 : 0.0);
  if (!value.is_array()) return true;
  return std::any_of(value.begin(), value.end(),
                     [](const json& each) { return says_something("", each); });
}

}  // namespace

json read_transforms_json(const fs::path& path) {
  const std::string text = read_file(path);
  const json root = json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (root.is_discarded()) {
    if (const std::string other = io::stand_in(text.substr(0, 1024), path); !other.empty())
      throw DataError(concat(path.string(), ": expected JSON in UTF-8, found ", other));
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

std::string text_of(const json& frame, const char* key, const std::string& where) {
  if (!frame.is_object() || !frame.contains(key) || frame[key].is_null()) return {};
  if (frame[key].is_string()) return frame[key].get<std::string>();
  throw DataError(concat(where, ": expected '", key, "' to be a path in quotes"));
}

geometry::Pose pose_of_matrix(const json& matrix, const std::string& where) {
  geometry::Pose world_from_camera =
      rigid_pose(matrix, concat(where,
                                ": expected 'transform_matrix' to be a 4x4 rotation and "
                                "translation, world_from_camera in OpenGL axes"));
  for (size_t i = 0; i < 9; ++i) {
    if (i % 3 > 0) world_from_camera.rotation[i] = -world_from_camera.rotation[i];
  }
  return geometry::inverse(world_from_camera);
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
  // A frame's own field of view replaces the file's focal length.
  const bool has_own_angle = states_angle(frame) && !states_focal_length(frame);
  const auto focal = [&](const char* key) {
    const double found = has_own_angle ? 0 : value(key, 0);
    if (found >= 0) return found;
    throw DataError(concat(where, ": expected a focal length '", key, "' above 0, found ", found,
                           "; correct it"));
  };
  camera.fx = focal("fl_x");
  camera.fy = focal("fl_y");
  camera.cx = value("cx", 0);
  camera.cy = value("cy", 0);
  return camera;
}

double angle_of(const json& root, const json& frame, char axis, const std::string& where) {
  const auto value = [&](const json& object, const std::string& key, double most,
                         const char* unit) {
    const double found = number(object, key, 0, where);
    if (found >= 0 && found < most) return found;
    throw DataError(concat(where, ": expected '", key, "' from 0 to ", most, " ", unit, ", found ",
                           found, "; correct it"));
  };
  constexpr double kRadiansPerDegree = 3.14159265358979323846 / 180;
  for (const json* object : {&frame, &root}) {
    // A frame's own focal length replaces the file's fields of view.
    if (object == &root && states_focal_length(frame)) break;
    const double angle = value(*object, concat("camera_angle_", axis), 3.1, "radians");
    if (angle > 0) return angle;
    const double degrees = value(*object, concat(axis, "_fov"), 177, "degrees");
    if (degrees > 0) return kRadiansPerDegree * degrees;
  }
  return 0;
}

double angle_beside_focal(const json& root, const json& frame, char axis) {
  const json& object = frame.contains(concat("fl_", axis)) ? frame : root;
  const auto angle = object.find(concat("camera_angle_", axis));
  if (angle == object.end() || !angle->is_number()) return 0;
  const auto found = angle->get<double>();
  return found > 0 && found < 3.1 ? found : 0;
}

std::string camera_model_of(const json& root, const json& frame) {
  std::string model = text_value(root, frame, "camera_model");
  std::transform(model.begin(), model.end(), model.begin(),
                 [](unsigned char letter) { return char(std::toupper(letter)); });
  return model;
}

geometry::Lens lens_of_frame(const json& root, const json& frame, const std::string& where) {
  using geometry::LensModel;
  const std::string model = camera_model_of(root, frame);
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
  const json coefficients = coefficients_of(root, frame, where);
  const auto value = [&](const char* key) { return number(coefficients, key, 0, where); };
  geometry::Lens lens{LensModel::kPinhole, value("k1"), value("k2"),
                      value("p1"),         value("p2"), value("k3"),
                      value("k4"),         0,           0};
  if (fisheyes.count(model) > 0 ||
      flag(frame.contains("camera_model") ? frame : root, frame, "is_fisheye")) {
    lens.model = LensModel::kFisheye;
    lens.p1 = lens.p2 = 0;
    return lens;
  }
  const bool is_pinhole = model == "PINHOLE" || model == "SIMPLE_PINHOLE";
  if (is_pinhole && !has_coefficients(lens)) return {};
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

void add_keys(const json& root, std::set<std::string>& keys) {
  const auto add = [&](const json& object) {
    for (const auto& [key, value] : object.items()) {
      if (says_something(key, value)) keys.insert(key);
    }
  };
  add(root);
  for (const json& frame : root["frames"]) {
    if (frame.is_object()) add(frame);
  }
}

const std::vector<FormatPart>& unused_keys() {
  static const std::vector<FormatPart> keys = {
      {"depth_file_path", "depth maps"},
      {"depth_path", "depth maps"},
      {"normal_file_path", "maps of normals"},
      {"normal_path", "maps of normals"},
      {"semantics_path", "semantic labels"},
      {"segmentation_path", "semantic labels"},
      {"time", "moment of a scene that moves"},
      {"timestamp", "time of a frame"},
      {"rolling_shutter", "motion while rows are read"},
      {"enable_rolling_shutter", "motion while rows are read"},
      {"rolling_shutter_time", "motion while rows are read"},
      {"shutter_time", "motion while a frame is exposed"},
      {"exposure", "brightness of a frame"},
      {"exposure_time", "length of an exposure"},
      {"iso", "brightness of a frame"},
      {"aperture", "brightness of a frame"},
      {"white_balance", "colours of a frame"},
      {"camera_linear_velocity", "motion while a frame is exposed"},
      {"camera_angular_velocity", "motion while a frame is exposed"},
      {"linear_velocity", "motion while a frame is exposed"},
      {"angular_velocity", "motion while a frame is exposed"},
      {"transform_matrix_start", "motion while a frame is exposed"},
      {"transform_matrix_end", "motion while a frame is exposed"},
      {"mask_color", "a colour that marks masked pixels"},
      {"white_transparent", "white marks masked pixels"},
      {"black_transparent", "black marks masked pixels"},
      {"scale", "scale of the world; poses are taken as they are"},
      {"offset", "origin of the world; poses are taken as they are"},
      {"aabb_scale", "bounds of the scene"},
      {"render_aabb", "bounds of the scene"},
      {"orientation_override", "axes of the world; poses are taken as they are"},
      {"n_extra_learnable_dims", "a look of its own for each frame"},
  };
  return keys;
}

}  // namespace jade::data
