// SPDX-License-Identifier: Apache-2.0
#include "jade/data/cameras.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <nlohmann/json.hpp>
#include <unordered_set>

#include "jade/core/atomic_file.h"
#include "jade/core/edit_distance.h"
#include "jade/core/error.h"
#include "jade/data/pose_matrix.h"

namespace jade::data {
namespace {

using nlohmann::json;

/// Keys that change a view, or are checked.
const std::vector<std::string> kKeys{"width",
                                     "height",
                                     "fx",
                                     "fy",
                                     "cx",
                                     "cy",
                                     "name",
                                     "img_name",
                                     "position",
                                     "rotation",
                                     "camera_from_world",
                                     "distortion",
                                     "distortion_params",
                                     "camera_model",
                                     "camera_type",
                                     "k1",
                                     "k2",
                                     "k3",
                                     "k4",
                                     "k5",
                                     "k6",
                                     "is_fisheye",
                                     "model",
                                     "p1",
                                     "p2",
                                     "id"};

/// Refuses keys that are not read: all of this program's own files, and those of other files that
/// look like a misspelt one that is missing.
void check_keys(const json& map, bool is_own) {
  for (const auto& [key, value] : map.items()) {
    if (std::find(kKeys.begin(), kKeys.end(), key) != kKeys.end()) continue;
    const std::string close = misspelt(key, kKeys);
    // Short words that change no view are like many others.
    const bool may_pass = close.empty() || close == "name" || close == "model" || close == "id";
    if (!is_own && (may_pass || map.contains(close))) continue;
    throw DataError(concat(
        "expected keys of a camera, found \"", key, "\"",
        close.empty() ? ", which is none; remove it" : concat("; did you mean \"", close, "\"?")));
  }
}

/// A value of the entry, else of the defaults.
const json* value_of(const json& entry, const json& defaults, const std::string& key) {
  if (entry.contains(key)) return &entry.at(key);
  if (defaults.contains(key)) return &defaults.at(key);
  return nullptr;
}

DataError unlike(const char* key, const char* expected, const json& found) {
  return DataError(concat("expected \"", key, "\" to be ", expected, ", found ",
                          found.dump(-1, ' ', false, json::error_handler_t::replace).substr(0, 40),
                          "; correct it"));
}

double required(const json& entry, const json& defaults, const char* key) {
  const json* value = value_of(entry, defaults, key);
  if (value == nullptr) throw DataError(concat("expected the key \"", key, "\""));
  if (!value->is_number()) throw unlike(key, "a number", *value);
  return value->get<double>();
}

/// A whole number of pixels.
int64_t required_pixels(const json& entry, const json& defaults, const char* key) {
  const double value = required(entry, defaults, key);
  if (value == std::floor(value) && std::abs(value) < 1e9) return static_cast<int64_t>(value);
  throw DataError(concat("expected \"", key, "\" to be a whole number of pixels, found ", value));
}

/// Views are rendered with a pinhole camera.
void check_undistorted(const json& entry, const json& defaults) {
  for (const char* key : {"camera_model", "model", "camera_type"}) {
    const json* value = value_of(entry, defaults, key);
    if (value == nullptr || value->is_null()) continue;
    const std::string given = value->is_string() ? value->get<std::string>() : value->dump();
    std::string model = given;
    std::transform(model.begin(), model.end(), model.begin(),
                   [](unsigned char letter) { return char(std::toupper(letter)); });
    // Models with radial coefficients are pinholes if these are 0, which is checked below.
    const std::array pinholes{"PINHOLE",       "SIMPLE_PINHOLE", "PERSPECTIVE", "OPENCV",
                              "SIMPLE_RADIAL", "RADIAL",         "FULL_OPENCV"};
    if (std::find(pinholes.begin(), pinholes.end(), model) != pinholes.end()) continue;
    throw DataError(concat("expected \"", key, "\" to be PINHOLE, found ", given,
                           "; remove it to render as a pinhole camera"));
  }
  for (const char* key : {"k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", "distortion",
                          "distortion_params", "is_fisheye"}) {
    const json* value = value_of(entry, defaults, key);
    if (value == nullptr) continue;
    const bool zero = value->is_array() ? std::all_of(value->begin(), value->end(),
                                                      [](const json& each) { return each == 0; })
                                        : value->empty() || *value == 0 || *value == false;
    if (zero) continue;
    throw DataError(concat("expected a camera without distortion, found \"", key,
                           "\"; remove it to render as a pinhole camera"));
  }
}

std::array<double, 3> three_numbers(const char* key, const char* expected, const json& whole,
                                    const json& part) {
  const bool numbers =
      part.is_array() && part.size() == 3 &&
      std::all_of(part.begin(), part.end(), [](const json& each) { return each.is_number(); });
  if (!numbers) throw unlike(key, expected, whole);
  return part.get<std::array<double, 3>>();
}

/// The pose in the form of 3DGS: the camera's centre, and the rotation to the world.
geometry::Pose placed_pose(const json& entry) {
  const json& rows = entry.at("rotation");
  const json& position = entry.at("position");
  if (!rows.is_array() || rows.size() != 3) throw unlike("rotation", "3x3 numbers", rows);
  geometry::Matrix3 rotation;
  for (size_t c = 0; c < 3; ++c) {
    const auto row = three_numbers("rotation", "3x3 numbers", rows, rows[c]);
    for (size_t r = 0; r < 3; ++r) rotation[3 * r + c] = row[r];
  }
  return geometry::pose_at_centre(
      rotation_near(rotation, "expected \"rotation\" to be 3x3, world from camera"),
      three_numbers("position", "3 numbers", position, position));
}

/// Whether two poses are equal up to the rounding of text.
bool agree(const geometry::Pose& a, const geometry::Pose& b) {
  constexpr double kRounding = 1e-5;
  const geometry::Vector3 p = geometry::centre(a), q = geometry::centre(b);
  double distance = 0, size = 1;
  for (size_t i = 0; i < 3; ++i) {
    distance = std::max(distance, std::abs(p[i] - q[i]));
    size = std::max(size, std::abs(p[i]));
  }
  return distance <= kRounding * size && geometry::rotation_angle(a, b) <= 1e-3;
}

geometry::Pose pose_of(const json& entry) {
  const bool placed = entry.contains("position") && entry.contains("rotation");
  if (!entry.contains("camera_from_world")) {
    if (placed) return placed_pose(entry);
    throw DataError("expected \"camera_from_world\", or \"position\" with \"rotation\"");
  }
  const geometry::Pose pose =
      rigid_pose(entry.at("camera_from_world"),
                 "expected \"camera_from_world\" to be 3 or 4 rows of a rotation and "
                 "translation (x right, y down, z forward)");
  const bool has_either = entry.contains("position") || entry.contains("rotation");
  if (has_either && !(placed && agree(pose, placed_pose(entry)))) {
    throw DataError(
        "expected \"position\" and \"rotation\" to be the pose of \"camera_from_world\", found "
        "another; remove the form that is out of date");
  }
  return pose;
}

NamedCamera camera_of(const json& entry, const json& defaults, size_t index) {
  NamedCamera result;
  geometry::Intrinsics& camera = result.camera;
  check_keys(entry, entry.contains("camera_from_world"));
  check_undistorted(entry, defaults);
  camera.width = required_pixels(entry, defaults, "width");
  camera.height = required_pixels(entry, defaults, "height");
  camera.fx = required(entry, defaults, "fx");
  const auto optional = [&](const char* key, double fallback) {
    return value_of(entry, defaults, key) == nullptr ? fallback : required(entry, defaults, key);
  };
  camera.fy = optional("fy", camera.fx);
  camera.cx = optional("cx", static_cast<double>(camera.width) / 2);
  camera.cy = optional("cy", static_cast<double>(camera.height) / 2);
  if (!(camera.width > 0 && camera.height > 0 && camera.width <= 32767 && camera.height <= 32767 &&
        camera.fx > 0 && camera.fy > 0)) {
    throw DataError("expected positive width, height (up to 32767), fx and fy");
  }
  result.camera_from_world = pose_of(entry);
  result.name = std::to_string(index);
  for (const char* key : {"img_name", "name"}) {
    if (!entry.contains(key)) continue;
    if (!entry.at(key).is_string()) throw unlike(key, "a text", entry.at(key));
    result.name = entry.at(key).get<std::string>();
  }
  if (result.name.empty() || result.name.find('/') != std::string::npos) {
    throw DataError(concat("expected a name that is a plain file name, found '", result.name, "'"));
  }
  if (result.name.find('\0') != std::string::npos) {
    throw DataError("expected a name that is a plain file name, found one with a NUL character");
  }
  return result;
}

/// Parses the file: a list, or an object whose other keys all cameras share.
json parsed(const std::filesystem::path& path) {
  const std::string text = read_file(path);
  json document;
  try {
    document = json::parse(text);
  } catch (const json::parse_error& problem) {
    const std::string found =
        problem.byte > text.size()
            ? "its end too early"
            : concat("what is none at byte ", problem.byte, " of ", text.size());
    throw DataError(
        concat(path.string(), ": expected JSON, found ", found, "; is the file whole?"));
  }
  if (document.is_array() || (document.is_object() && document.contains("cameras"))) {
    return document;
  }
  throw DataError(concat(path.string(),
                         ": expected a list of cameras, or an object with that list as "
                         "\"cameras\", found neither"));
}

/// The JSON library's message without its error number.
std::string words_of(const json::exception& problem) {
  const std::string text = problem.what();
  const size_t end = text.find("] ");
  return end == std::string::npos ? text : text.substr(end + 2);
}

}  // namespace

std::vector<NamedCamera> read_cameras(const std::filesystem::path& path) {
  std::vector<NamedCamera> cameras;
  std::unordered_set<std::string> names;
  size_t index = 0;
  std::string where;  // of a message, in the file
  try {
    const json document = parsed(path);
    const json& list = document.is_array() ? document : document.at("cameras");
    json defaults = document.is_object() ? document : json::object();
    defaults.erase("cameras");
    check_keys(defaults, true);
    for (const json& entry : list) {
      where = concat(": entry ", index);
      cameras.push_back(camera_of(entry, defaults, index));
      if (!names.insert(cameras.back().name).second) {
        throw DataError(concat("expected names that differ, found '", cameras.back().name,
                               "' again; images are named after their cameras"));
      }
      ++index;
    }
  } catch (const json::exception& problem) {
    throw DataError(concat(path.string(), where, ": ", words_of(problem)));
  } catch (const DataError& problem) {
    const std::string text = problem.what();
    if (text.find(path.string()) == 0) throw;
    throw DataError(concat(path.string(), where, ": ", text));
  }
  if (cameras.empty()) throw DataError(concat(path.string(), ": expected at least one camera"));
  return cameras;
}

void write_cameras(const std::filesystem::path& path, const std::vector<NamedCamera>& cameras) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const NamedCamera& view : cameras) {
    const geometry::Matrix3& r = view.camera_from_world.rotation;
    const geometry::Vector3& t = view.camera_from_world.translation;
    nlohmann::ordered_json rows = nlohmann::ordered_json::array();
    nlohmann::ordered_json axes = nlohmann::ordered_json::array();
    for (size_t i = 0; i < 3; ++i) {
      rows.push_back({r[3 * i], r[3 * i + 1], r[3 * i + 2], t[i]});
      axes.push_back({r[i], r[3 + i], r[6 + i]});
    }
    list.push_back({{"id", list.size()},
                    {"name", view.name},
                    {"img_name", view.name},
                    {"width", view.camera.width},
                    {"height", view.camera.height},
                    {"fx", view.camera.fx},
                    {"fy", view.camera.fy},
                    {"cx", view.camera.cx},
                    {"cy", view.camera.cy},
                    {"position", geometry::centre(view.camera_from_world)},
                    {"rotation", std::move(axes)},
                    {"camera_from_world", std::move(rows)}});
  }
  // File names need not be UTF-8.
  write_file(path, list.dump(1, ' ', false, json::error_handler_t::replace) + "\n");
}

std::vector<NamedCamera> dataset_cameras(const Dataset& dataset, CameraSet which,
                                         const std::string& name) {
  std::vector<NamedCamera> cameras;
  if (which == CameraSet::kTest) {
    for (const SharpView& view : dataset.test) {
      cameras.push_back({view.name, view.pose, view.camera});
    }
  }
  const auto add_poses = [&](const Exposure& exposure) {
    for (size_t k = 0; k < exposure.poses.size(); ++k) {
      cameras.push_back({concat(exposure.name, "_", k), exposure.poses[k], exposure.camera});
    }
  };
  for (const Exposure& exposure : dataset.train) {
    if (which == CameraSet::kTrain) {
      cameras.push_back({exposure.name, exposure.poses[geometry::kMidPose], exposure.camera});
    } else if (which == CameraSet::kExposure && (name.empty() || name == exposure.name)) {
      add_poses(exposure);
    }
  }
  for (const Exposure& exposure : dataset.held_out) {
    if (which == CameraSet::kExposure && name == exposure.name) add_poses(exposure);
  }
  if (cameras.empty()) {
    throw DataError(concat(dataset.root.string(), ": has no view for --cameras ", word_of(which),
                           name.empty() ? "" : " --exposure " + name));
  }
  return cameras;
}

}  // namespace jade::data
