// SPDX-License-Identifier: Apache-2.0
#include "jade/import/calibration.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <optional>
#include <sstream>

#include "jade/config/document.h"
#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/text.h"
#include "jade/data/undistorter.h"
#include "jade/import/calibration_basalt.h"
#include "jade/import/calibration_fields.h"
#include "jade/import/calibration_matrix.h"
#include "jade/import/calibration_xml.h"
#include "jade/io/stand_in.h"

namespace jade::import {
namespace {

using config::DocumentNode;

/// Focal lengths of any real camera, as multiples of the image's larger side, and the largest ratio
/// of the two.
constexpr double kShortest = 0.02, kLongest = 100, kUnlike = 3;

[[noreturn]] void fail_several(const std::filesystem::path& path, const std::string& names) {
  throw DataError(
      concat(path.string(), ": expected the calibration of one camera, found ", names,
             "; keep the one of the recording's frames, or give the chain of Kalibr for "
             "two"));
}

/// The one camera of this map. @throws DataError naming the keys of a stereo calibration.
CameraKeys only_camera(const std::filesystem::path& path, const std::vector<CameraKeys>& cameras) {
  std::string names;
  for (const CameraKeys& keys : cameras) names += (names.empty() ? "" : " and ") + keys.matrix;
  if (cameras.size() > 1) fail_several(path, names);
  return cameras.front();
}

/// cam_to_cam.yaml of DSEC has up to eight cameras, and does not say which one took the frames.
void refuse_dsec(const std::filesystem::path& path, const DocumentNode& root) {
  const DocumentNode* const all = root.find("intrinsics");
  if (all == nullptr || all->kind != DocumentNode::Kind::kMap) return;
  std::string names;
  for (const auto& [name, node] : all->entries) {
    if (node.find("camera_matrix") != nullptr) names += (names.empty() ? "" : ", ") + name;
  }
  if (names.empty()) return;
  throw DataError(concat(path.string(),
                         ": expected the calibration of one camera or the chain of Kalibr, found "
                         "cam_to_cam.yaml of DSEC with the cameras ",
                         names,
                         "; write the camera of the frames as cam0 of a chain, with its "
                         "camera_matrix as intrinsics"));
}

/// One camera per section of the file, as in DV's form of OpenCV's storage; no value if no section
/// is a camera.
std::optional<Calibration> dv_storage(const std::filesystem::path& path, const DocumentNode& root) {
  Calibration out{path, {}, {}};
  std::string names;
  for (const auto& [name, node] : root.entries) {
    const auto cameras = camera_keys(node);
    if (cameras.empty()) continue;
    names += (names.empty() ? "" : " and ") + name;
    out.cameras.push_back(
        matrix_camera({path, name, node}, only_camera(path, cameras), lens_kind({path, "", root})));
  }
  if (out.cameras.size() > 1) fail_several(path, names);
  return out.cameras.empty() ? std::nullopt : std::optional(out);
}

/// The JSON of dv-processing: {"version": "2.0", "cameras": {"C0": {…}}}.
/// Whether a list has a number other than 0.
bool has_coefficients(const Section& section, const std::string& key) {
  const DocumentNode* const node = section.node.find(key);
  if (node == nullptr || (node->kind == DocumentNode::Kind::kText && node->text.empty()))
    return false;
  const std::vector<double> all = numbers(section, key, *node);
  return std::any_of(all.begin(), all.end(), [](double each) { return each != 0; });
}

Calibration dv_set(const std::filesystem::path& path, const DocumentNode& cameras) {
  std::string names;
  for (const auto& [name, node] : cameras.entries) names += (names.empty() ? "" : " and ") + name;
  if (cameras.entries.size() != 1) fail_several(path, names.empty() ? "none" : names);
  const Section section{path, "cameras." + names, cameras.entries.front().second};
  CalibratedCamera camera;
  const auto focal = numbers(section, "focalLength", "[fx, fy]", 2);
  const auto centre = numbers(section, "principalPoint", "[cx, cy]", 2);
  const auto size = numbers(section, "resolution", "[width, height]", 2);
  camera.fx = focal[0], camera.fy = focal[1];
  camera.cx = centre[0] + 0.5, camera.cy = centre[1] + 0.5;
  camera.width = int64_t(size[0]), camera.height = int64_t(size[1]);
  refuse_misspelt(section, {"distortionmodel", "distortioncoefficients"},
                  [](const DocumentNode&) { return true; });
  const std::string model = word(section, "distortionModel"), key = "distortionCoefficients";
  if (model == "none" || (model.empty() && !has_coefficients(section, key))) {
    return {path, {camera}, {}};
  }
  const bool is_fisheye = model == "equidistant";
  if (!is_fisheye && model != "radialTangential") {
    throw DataError(concat(section.where("distortionModel"),
                           ": expected radialTangential, equidistant or none, found '", model,
                           "'; calibrate with one of these models"));
  }
  const auto k = numbers(section, key, require(section, key, "the lens's coefficients"));
  if (k.size() != 4 && (is_fisheye || k.size() != 5)) {
    throw DataError(concat(section.where(key), ": expected 4", is_fisheye ? "" : " or 5",
                           " coefficients, found ", k.size(), "; calibrate again"));
  }
  camera.lens = checked(is_fisheye ? fisheye(k) : radial_tangential(k), k);
  return {path, {camera}, {}};
}

/// fx fy cx cy, alone or with k1 k2 p1 p2 [k3].
Calibration rpg(const std::filesystem::path& path, const std::vector<double>& k) {
  constexpr const char* kNames[] = {"fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"};
  for (size_t i = 0; i < k.size(); ++i) {
    if (std::isfinite(k[i])) continue;
    throw DataError(concat(path.string(), ": expected ", kNames[i], " to be a number, found ", k[i],
                           "; calibrate again"));
  }
  CalibratedCamera camera;
  camera.fx = k[0], camera.fy = k[1], camera.cx = k[2] + 0.5, camera.cy = k[3] + 0.5;
  const std::vector<double> lens(k.begin() + 4, k.end());
  if (!lens.empty()) camera.lens = checked(radial_tangential(lens), lens);
  return {path, {camera}, {}};
}

/// Whether nine or twelve numbers are a camera matrix in rows: fx s cx 0 fy cy 0 0 1, or with a
/// fourth column of zeros.
bool is_matrix(const std::vector<double>& k) {
  if (k.size() != 9 && k.size() != 12) return false;
  const size_t columns = k.size() / 3;
  const auto at = [&](size_t row, size_t column) { return k[columns * row + column]; };
  const bool last = at(2, 0) == 0 && at(2, 1) == 0 && at(2, 2) == 1;
  return last && at(1, 0) == 0 &&
         (columns == 3 || (at(0, 3) == 0 && at(1, 3) == 0 && at(2, 3) == 0));
}

/// A camera matrix alone: a pinhole without distortion.
Calibration plain_matrix(const std::filesystem::path& path, const std::vector<double>& k) {
  const size_t columns = k.size() / 3;
  if (std::abs(k[1]) > 1e-3 * std::abs(k[0])) {
    throw DataError(concat(path.string(), ": expected a 3x3 matrix without skew, found ", k[1],
                           " there; calibrate without"));
  }
  CalibratedCamera camera;
  camera.fx = k[0], camera.fy = k[columns + 1];
  camera.cx = k[2] + 0.5, camera.cy = k[columns + 2] + 0.5;
  return {path, {camera}, {}};
}

/// The numbers of a file that contains nothing else but commas, semicolons or brackets between
/// them, and comments behind '#'; NaN is allowed.
std::vector<double> plain_numbers(std::string text) {
  for (size_t at = 0; (at = text.find('#', at)) != std::string::npos;)
    text.erase(at, std::min(text.find('\n', at), text.size()) - at);
  const auto parts = [](char c) { return c == ',' || c == ';' || c == '[' || c == ']'; };
  std::replace_if(text.begin(), text.end(), parts, ' ');
  std::istringstream in(text);
  std::vector<double> out;
  for (std::string word; in >> word;) {
    char* end = nullptr;
    out.push_back(std::strtod(word.c_str(), &end));
    if (end != word.c_str() + word.size()) return {};
  }
  return out;
}

CalibratedCamera kalibr_camera(const Section& section) {
  CalibratedCamera camera;
  camera.name = section.name;
  camera.topic = word(section, "rostopic");
  const std::string model = word(section, "camera_model");
  if (model != "pinhole") {
    throw DataError(concat(section.where("camera_model"), ": expected pinhole, found '", model,
                           "'; calibrate with pinhole-radtan or pinhole-equi"));
  }
  const auto matrix = numbers(section, "intrinsics", "[fx, fy, cx, cy]", 4);
  camera.fx = matrix[0], camera.fy = matrix[1];
  camera.cx = matrix[2] + 0.5, camera.cy = matrix[3] + 0.5;
  const auto size = numbers(section, "resolution", "[width, height]", 2);
  camera.width = int64_t(size[0]), camera.height = int64_t(size[1]);
  const std::string lens = word(section, "distortion_model");
  if (lens == "none") return camera;
  if (lens != "radtan" && lens != "equidistant") {
    throw DataError(concat(section.where("distortion_model"),
                           ": expected radtan, equidistant or none, found '", lens,
                           "'; calibrate with pinhole-radtan or pinhole-equi"));
  }
  const auto k = numbers(section, "distortion_coeffs", "its coefficients", 4);
  camera.lens = checked(lens == "radtan" ? radial_tangential(k) : fisheye(k), k);
  return camera;
}

geometry::Pose kalibr_pose(const Section& section) {
  const auto m = numbers(section, "T_cn_cnm1", "the pose beside the camera before it", 16);
  geometry::Pose pose;
  pose.translation = {m[3], m[7], m[11]};
  try {
    pose.rotation =
        geometry::nearest_rotation({m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]});
  } catch (const ContractError&) {
    throw DataError(concat(section.where("T_cn_cnm1"),
                           ": expected a rotation, found none; correct "
                           "the matrix, or calibrate both cameras again"));
  }
  return pose;
}

/// "cam0", "cam1", …
bool is_chain_name(const std::string& name) {
  return name.size() > 3 && name.rfind("cam", 0) == 0 &&
         name.find_first_not_of("0123456789", 3) == std::string::npos;
}

/// Reads cam0 and cam1 of a chain by Kalibr, and names its other cameras as unused.
Calibration kalibr(const std::filesystem::path& path, const DocumentNode& root) {
  Calibration calibration{path, {}, {}};
  for (const char* name : {"cam0", "cam1"}) {
    const DocumentNode* node = root.find(name);
    if (!node) break;
    const Section section{path, name, *node};
    if (!calibration.cameras.empty()) calibration.second_from_first = kalibr_pose(section);
    calibration.cameras.push_back(kalibr_camera(section));
  }
  for (const auto& [name, node] : root.entries) {
    const bool used = name == "cam0" || (name == "cam1" && calibration.cameras.size() > 1);
    if (!used && is_chain_name(name)) calibration.unused.push_back(name);
  }
  return calibration;
}

/// Kalibr writes its results as text too.
void refuse_report(const std::filesystem::path& path, const std::string& text) {
  if (text.compare(0, std::char_traits<char>::length("Calibration results"),
                   "Calibration results") != 0)
    return;
  throw DataError(concat(path.string(),
                         ": expected the camchain .yaml of Kalibr, found its report as text; give "
                         "the file NAME-camchain.yaml (or camchain-NAME.yaml) beside it"));
}

DocumentNode document(const std::filesystem::path& path) {
  try {
    return config::read_document(path);
  } catch (const ConfigError& error) {
    throw DataError(error.what());
  }
}

}  // namespace

Calibration read_calibration(const std::filesystem::path& path) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) {
    throw DataError(
        concat(path.string(), ": expected a calibration file, found none; correct the path"));
  }
  const std::string text = without_mark(read_file(path));
  if (const std::string other = io::stand_in(text.substr(0, 1024), path); !other.empty())
    throw DataError(concat(path.string(), ": expected a calibration file, found ", other));
  const auto row = plain_numbers(text);
  if (is_matrix(row)) return plain_matrix(path, row);
  if (row.size() == 4 || row.size() == 8 || row.size() == 9) return rpg(path, row);
  refuse_report(path, text);
  const DocumentNode root = is_xml(text) ? read_xml(path, text) : document(path);
  if (root.find("cam0")) return kalibr(path, root);
  if (const auto* intrinsics = basalt_intrinsics(root)) return read_basalt(path, *intrinsics, root);
  refuse_dsec(path, root);
  if (const auto cameras = camera_keys(root); !cameras.empty()) {
    const CameraKeys keys = only_camera(path, cameras);
    return {path, {matrix_camera({path, "", root}, keys, LensKind::kUnsaid)}, {}};
  }
  if (const DocumentNode* cameras = root.find("cameras");
      cameras != nullptr && cameras->kind == DocumentNode::Kind::kMap) {
    return dv_set(path, *cameras);
  }
  if (const auto storage = dv_storage(path, root)) return *storage;
  throw DataError(concat(path.string(),
                         ": expected a calibration by Kalibr (cam0), OpenCV or ROS (camera_matrix, "
                         "or K and D), DV (cameras), basalt (value0), RPG (fx fy cx cy, alone or "
                         "with k1 k2 p1 p2 [k3]) or a 3x3 matrix, found ",
                         row.empty() ? "none of these" : concat(row.size(), " numbers"),
                         "; export it in one of these forms"));
}

geometry::LensCamera camera_of(const Calibration& calibration, size_t index, int64_t width,
                               int64_t height, const std::string& what) {
  const std::string path = calibration.path.string();
  if (index >= calibration.cameras.size()) {
    throw DataError(concat(path, ": expected a camera ", index, " for the ", what, ", found ",
                           calibration.cameras.size()));
  }
  const CalibratedCamera& camera = calibration.cameras[index];
  if (camera.width > 0 && (camera.width != width || camera.height != height)) {
    throw DataError(concat(path, ": calibrated at ", camera.width, "x", camera.height, ", the ",
                           what, " have ", width, "x", height,
                           "; calibrate at the recording's size"));
  }
  const geometry::Intrinsics pinhole{camera.fx, camera.fy, camera.cx, camera.cy, width, height};
  if (!(camera.fx > 0 && camera.fy > 0 && data::principal_point_inside(pinhole))) {
    throw DataError(concat(path, ": expected a principal point inside ", width, "x", height,
                           ", a hundredth of it from its borders, and focal lengths above 0, "
                           "found fx ",
                           camera.fx, ", fy ", camera.fy, ", cx ", camera.cx - 0.5, ", cy ",
                           camera.cy - 0.5, "; calibrate again"));
  }
  const double side = double(std::max(width, height));
  const auto [least, most] = std::minmax(camera.fx, camera.fy);
  if (least < kShortest * side || most > kLongest * side || most > kUnlike * least) {
    throw DataError(concat(path, ": expected focal lengths in pixels, from ", kShortest * side,
                           " to ", kLongest * side, " for ", width, "x", height,
                           " and about equal, found fx ", camera.fx, " and fy ", camera.fy,
                           "; correct them, or calibrate again"));
  }
  return {pinhole, camera.lens};
}

namespace {

/// Whether a topic is one of events, or of images made from them.
/// @param words  that mark it
bool says_events(const std::string& topic, const std::vector<std::string>& words) {
  const std::string name = in_small_letters(topic);
  return std::any_of(words.begin(), words.end(),
                     [&](const std::string& word) { return name.find(word) != std::string::npos; });
}

/// The camera of the two whose topic is that of events; no value: both, or neither.
std::optional<size_t> camera_of_events(const std::vector<CalibratedCamera>& cameras) {
  // Cameras of events have topics of frames too, so that the word itself decides first.
  for (const std::vector<std::string>& words :
       {std::vector<std::string>{"event", "e2vid", "reconstruct"},
        std::vector<std::string>{"dvs", "davis", "dvx", "prophesee", "metavision", "evk"}}) {
    const bool first = says_events(cameras[0].topic, words);
    if (first != says_events(cameras[1].topic, words)) return first ? 0 : 1;
  }
  return std::nullopt;
}

}  // namespace

std::string put_frames_first(Calibration& calibration, int64_t width, int64_t height) {
  if (!calibration.second_from_first) return "";
  std::vector<CalibratedCamera>& cameras = calibration.cameras;
  const auto fits = [&](const CalibratedCamera& camera) {
    return camera.width == width && camera.height == height;
  };
  const bool by_size = fits(cameras[0]) != fits(cameras[1]);
  std::optional<size_t> events = camera_of_events(cameras);
  if (by_size) {
    const size_t other = fits(cameras[0]) ? 1 : 0;
    if (events && *events != other) return "";  // calibrated at another size, which is refused
    events = other;
  }
  const auto said = [&](const std::string& found, const std::string& fix) {
    return concat(calibration.path.string(), ": expected ", cameras[0].name, " of the frames and ",
                  cameras[1].name, " of the events, found ", found, "; ", fix);
  };
  if (!events && fits(cameras[0])) {
    return said(
        "two of one size and no topic of events",
        concat(cameras[0].name, " is taken for the frames: if it is the event camera, ",
               cameras[0].name == "cam0" ? "write rostopic: /events into it" : "exchange the two"));
  }
  if (events != size_t(0)) return "";
  const std::string line =
      said(by_size ? "them the other way round by their sizes"
                   : "the topic of events, " + cameras[0].topic + ", at the first",
           concat(cameras[1].name, " is taken for the frames",
                  by_size ? "" : "; if it is the event camera, write rostopic: /events into it"));
  std::swap(cameras[0], cameras[1]);
  calibration.second_from_first = geometry::inverse(*calibration.second_from_first);
  return line;
}

std::string calibration_fault(const std::filesystem::path& path) {
  try {
    read_calibration(path);
    return "";
  } catch (const DataError& error) {
    std::string line = error.what();
    if (line.rfind(path.string(), 0) == 0) line.erase(0, path.string().size());
    return line.substr(0, line.find("; "));
  }
}

}  // namespace jade::import
