// SPDX-License-Identifier: Apache-2.0
#include "jade/import/calibration.h"

#include <cmath>
#include <cstdlib>
#include <optional>
#include <sstream>

#include "jade/config/document.h"
#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/data/undistorter.h"
#include "jade/import/calibration_xml.h"

namespace jade::import {
namespace {

using config::DocumentNode;
using geometry::LensModel;

/// A map of the file, and where it is for messages.
struct Section {
  const std::filesystem::path& path;
  std::string name;  ///< "cam0", or empty for the file itself
  const DocumentNode& node;

  std::string where(const std::string& key) const {
    return concat(path.string(), ":", node.line, ": ", name.empty() ? "" : name + ".", key);
  }
};

const DocumentNode& require(const Section& section, const std::string& key,
                            const std::string& meaning) {
  if (const DocumentNode* node = section.node.find(key)) return *node;
  throw DataError(concat(section.where(key), ": expected ", meaning, ", found nothing"));
}

double number(const Section& section, const std::string& key, const DocumentNode& node) {
  std::istringstream text(node.text);
  double value = 0;
  if (node.kind == DocumentNode::Kind::kText && text >> value && (text >> std::ws).eof() &&
      std::isfinite(value)) {
    return value;
  }
  throw DataError(concat(section.where(key), ": expected a number, found '", node.text, "'"));
}

/// Numbers of a list, of a list of lists, or of a matrix with `data`, in the file's order.
std::vector<double> numbers(const Section& section, const std::string& key,
                            const DocumentNode& node) {
  if (node.kind == DocumentNode::Kind::kMap) {
    const DocumentNode* data = node.find("data");
    if (data) return numbers(section, key, *data);
  }
  if (node.kind != DocumentNode::Kind::kList) {
    throw DataError(concat(section.where(key), ": expected a list of numbers, found '", node.text,
                           node.kind == DocumentNode::Kind::kMap ? "a map without data" : "", "'"));
  }
  std::vector<double> out;
  for (const DocumentNode& item : node.items) {
    if (item.kind == DocumentNode::Kind::kList) {
      const auto row = numbers(section, key, item);
      out.insert(out.end(), row.begin(), row.end());
    } else {
      out.push_back(number(section, key, item));
    }
  }
  return out;
}

std::vector<double> numbers(const Section& section, const std::string& key,
                            const std::string& meaning, size_t count) {
  auto out = numbers(section, key, require(section, key, meaning));
  if (out.size() == count) return out;
  throw DataError(concat(section.where(key), ": expected ", meaning, " (", count,
                         " numbers), found ", out.size(), " numbers"));
}

std::string word(const Section& section, const std::string& key) {
  const DocumentNode* node = section.node.find(key);
  return node && node->kind == DocumentNode::Kind::kText ? node->text : "";
}

geometry::Lens radial_tangential(const std::vector<double>& k) {
  geometry::Lens lens;
  lens.model = k.size() > 5 ? LensModel::kRational : LensModel::kRadialTangential;
  lens.k1 = k[0], lens.k2 = k[1], lens.p1 = k[2], lens.p2 = k[3];
  if (k.size() > 4) lens.k3 = k[4];
  if (k.size() > 7) lens.k4 = k[5], lens.k5 = k[6], lens.k6 = k[7];
  return lens;
}

geometry::Lens fisheye(const std::vector<double>& k) {
  return {LensModel::kFisheye, k[0], k[1], 0, 0, k[2], k[3], 0, 0};
}

/// Lenses without distortion need no model of it.
geometry::Lens checked(const geometry::Lens& lens, const std::vector<double>& k) {
  if (lens.model == LensModel::kFisheye) return lens;
  for (const double value : k) {
    if (value != 0) return lens;
  }
  return {};
}

CalibratedCamera kalibr_camera(const Section& section) {
  CalibratedCamera camera;
  camera.name = section.name;
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
    throw DataError(concat(section.where("T_cn_cnm1"), ": expected a rotation, found none"));
  }
  return pose;
}

Calibration kalibr(const std::filesystem::path& path, const DocumentNode& root) {
  Calibration calibration{path, {}, {}};
  for (const char* name : {"cam0", "cam1"}) {
    const DocumentNode* node = root.find(name);
    if (!node) break;
    const Section section{path, name, *node};
    if (!calibration.cameras.empty()) calibration.second_from_first = kalibr_pose(section);
    calibration.cameras.push_back(kalibr_camera(section));
  }
  return calibration;
}

/// Names of the keys of one camera: OpenCV's storage, or the messages of either ROS.
struct CameraKeys {
  const char *width, *height, *matrix, *lens;
};
constexpr CameraKeys kStorageKeys{"image_width", "image_height", "camera_matrix",
                                  "distortion_coefficients"};
constexpr CameraKeys kRos1Keys{"width", "height", "K", "D"}, kRos2Keys{"width", "height", "k", "d"};

/// Refuses skew, binning and the like, which this program does not support.
void check_plain_camera(const Section& section, const CameraKeys& keys,
                        const std::vector<double>& matrix) {
  if (matrix[0] == 0 && matrix[4] == 0) {
    throw DataError(concat(section.where(keys.matrix),
                           ": expected a camera matrix, found zeros: the camera was not calibrated "
                           "when this was recorded; calibrate it"));
  }
  if (std::abs(matrix[1]) > 1e-3 * std::abs(matrix[0])) {
    throw DataError(concat(section.where(keys.matrix), ": expected a matrix without skew, found ",
                           matrix[1], " there; calibrate without"));
  }
  for (const char* const key : {"binning_x", "binning_y"}) {
    const DocumentNode* const node = section.node.find(key);
    if (node == nullptr || number(section, key, *node) <= 1) continue;
    throw DataError(concat(section.where(key), ": expected 0 or 1, found ", node->text,
                           "; the matrix is that of the whole sensor, calibrate at the recording's "
                           "size"));
  }
}

CalibratedCamera matrix_camera(const Section& section, const CameraKeys& keys, bool fisheye_flag) {
  CalibratedCamera camera;
  camera.name = section.name;
  const auto matrix = numbers(section, keys.matrix, "a 3x3 camera matrix", 9);
  check_plain_camera(section, keys, matrix);
  camera.fx = matrix[0], camera.fy = matrix[4];
  camera.cx = matrix[2] + 0.5, camera.cy = matrix[5] + 0.5;
  const auto side = [&](const char* key) {
    return int64_t(number(section, key, require(section, key, "the size calibrated for")));
  };
  camera.width = side(keys.width), camera.height = side(keys.height);
  const std::string model = word(section, "distortion_model");
  const std::string key = keys.lens;
  const auto k = numbers(section, key, require(section, key, "the lens's coefficients"));
  const bool is_fisheye = model == "equidistant" || model == "fisheye" || fisheye_flag;
  if (!is_fisheye && !model.empty() && model != "plumb_bob" && model != "rational_polynomial") {
    throw DataError(concat(section.where("distortion_model"),
                           ": expected plumb_bob, rational_polynomial or fisheye, found '", model,
                           "'"));
  }
  if (k.empty()) return camera;
  const bool counts = is_fisheye ? k.size() == 4 : k.size() == 4 || k.size() == 5 || k.size() == 8;
  // OpenCV writes up to 14 coefficients; those after the eighth are of thin prisms and tilts.
  bool thin = !is_fisheye && (k.size() == 12 || k.size() == 14);
  for (size_t i = 8; thin && i < k.size(); ++i) thin = k[i] == 0;
  if (!counts && !thin) {
    throw DataError(concat(section.where(key), ": expected ", is_fisheye ? "4" : "4, 5 or 8",
                           " coefficients, found ", k.size(),
                           "; calibrate without thin-prism and tilt terms"));
  }
  camera.lens = checked(is_fisheye ? fisheye(k) : radial_tangential(k), k);
  return camera;
}

bool is_set(const DocumentNode& root, const char* key) {
  const DocumentNode* const node = root.find(key);
  return node != nullptr && (node->text == "1" || node->text == "true");
}

[[noreturn]] void fail_several(const std::filesystem::path& path, const std::string& names) {
  throw DataError(concat(path.string(), ": expected the calibration of one camera, found ", names,
                         "; keep the one of the recording, or give the chain of Kalibr for two"));
}

/// One camera to a section of the file, as DV writes OpenCV's storage; none where no section is a
/// camera's.
std::optional<Calibration> dv_storage(const std::filesystem::path& path, const DocumentNode& root) {
  Calibration out{path, {}, {}};
  std::string names;
  for (const auto& [name, node] : root.entries) {
    if (node.find(kStorageKeys.matrix) == nullptr) continue;
    names += (names.empty() ? "" : " and ") + name;
    out.cameras.push_back(
        matrix_camera({path, name, node}, kStorageKeys,
                      is_set(root, "use_fisheye_model") || is_set(node, "use_fisheye_model")));
  }
  if (out.cameras.size() > 1) fail_several(path, names);
  return out.cameras.empty() ? std::nullopt : std::optional(out);
}

/// The JSON of dv-processing: {"version": "2.0", "cameras": {"C0": {…}}}.
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
  const std::string model = word(section, "distortionModel");
  if (model.empty() || model == "none") return {path, {camera}, {}};
  const bool is_fisheye = model == "equidistant";
  if (!is_fisheye && model != "radialTangential") {
    throw DataError(concat(section.where("distortionModel"),
                           ": expected radialTangential, equidistant or none, found '", model,
                           "'"));
  }
  const std::string key = "distortionCoefficients";
  const auto k = numbers(section, key, require(section, key, "the lens's coefficients"));
  if (k.size() != 4 && (is_fisheye || k.size() != 5)) {
    throw DataError(concat(section.where(key), ": expected 4", is_fisheye ? "" : " or 5",
                           " coefficients, found ", k.size()));
  }
  camera.lens = checked(is_fisheye ? fisheye(k) : radial_tangential(k), k);
  return {path, {camera}, {}};
}

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
  camera.lens = checked(radial_tangential(lens), lens);
  return {path, {camera}, {}};
}

/// The numbers of a file that holds nothing else, NaN among them.
std::vector<double> plain_numbers(const std::string& text) {
  std::istringstream in(text);
  std::vector<double> out;
  for (std::string word; in >> word;) {
    char* end = nullptr;
    out.push_back(std::strtod(word.c_str(), &end));
    if (end != word.c_str() + word.size()) return {};
  }
  return out;
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
    throw DataError(concat(path.string(), ": expected a calibration file, found none"));
  }
  const std::string text = read_file(path);
  const auto plain = plain_numbers(text);
  if (plain.size() == 8 || plain.size() == 9) return rpg(path, plain);
  const DocumentNode root = is_xml(text) ? read_xml(path, text) : document(path);
  if (root.find("cam0")) return kalibr(path, root);
  if (root.find(kStorageKeys.matrix)) {
    const bool fisheye = is_set(root, "use_fisheye_model");
    return {path, {matrix_camera({path, "", root}, kStorageKeys, fisheye)}, {}};
  }
  for (const CameraKeys& keys : {kRos1Keys, kRos2Keys}) {
    if (root.find(keys.matrix) && root.find(keys.lens))
      return {path, {matrix_camera({path, "", root}, keys, false)}, {}};
  }
  if (const DocumentNode* cameras = root.find("cameras");
      cameras != nullptr && cameras->kind == DocumentNode::Kind::kMap) {
    return dv_set(path, *cameras);
  }
  if (const auto storage = dv_storage(path, root)) return *storage;
  throw DataError(concat(path.string(),
                         ": expected a calibration by Kalibr (cam0), OpenCV or ROS (camera_matrix, "
                         "or K and D), DV (cameras) or RPG (fx fy cx cy k1 k2 p1 p2 k3), found ",
                         plain.empty() ? "none of these" : concat(plain.size(), " numbers")));
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
  return {pinhole, camera.lens};
}

}  // namespace jade::import
