// SPDX-License-Identifier: Apache-2.0
#include "jade/import/calibration.h"

#include <cmath>
#include <sstream>

#include "jade/config/document.h"
#include "jade/core/atomic_file.h"
#include "jade/core/error.h"

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

Calibration open_cv(const std::filesystem::path& path, const DocumentNode& root) {
  const Section section{path, "", root};
  CalibratedCamera camera;
  const auto matrix = numbers(section, "camera_matrix", "a 3x3 camera matrix", 9);
  camera.fx = matrix[0], camera.fy = matrix[4];
  camera.cx = matrix[2] + 0.5, camera.cy = matrix[5] + 0.5;
  for (const char* key : {"image_width", "image_height"}) {
    const double size = number(section, key, require(section, key, "the size calibrated for"));
    (key[6] == 'w' ? camera.width : camera.height) = int64_t(size);
  }
  const std::string model = word(section, "distortion_model");
  const std::string key = "distortion_coefficients";
  const auto k = numbers(section, key, require(section, key, "the lens's coefficients"));
  const bool is_fisheye = model == "equidistant" || model == "fisheye";
  if (!is_fisheye && !model.empty() && model != "plumb_bob" && model != "rational_polynomial") {
    throw DataError(concat(section.where("distortion_model"),
                           ": expected plumb_bob, rational_polynomial or fisheye, found '", model,
                           "'"));
  }
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
  return {path, {camera}, {}};
}

Calibration rpg(const std::filesystem::path& path, const std::vector<double>& k) {
  CalibratedCamera camera;
  camera.fx = k[0], camera.fy = k[1], camera.cx = k[2] + 0.5, camera.cy = k[3] + 0.5;
  const std::vector<double> lens(k.begin() + 4, k.end());
  camera.lens = checked(radial_tangential(lens), lens);
  return {path, {camera}, {}};
}

/// The numbers of a file that holds nothing else.
std::vector<double> plain_numbers(const std::string& text) {
  std::istringstream in(text);
  std::vector<double> out;
  for (double value = 0; in >> value;) out.push_back(value);
  return in.eof() ? out : std::vector<double>{};
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
  const auto plain = plain_numbers(read_file(path));
  if (plain.size() == 8 || plain.size() == 9) return rpg(path, plain);
  const DocumentNode root = document(path);
  if (root.find("cam0")) return kalibr(path, root);
  if (root.find("camera_matrix")) return open_cv(path, root);
  throw DataError(concat(path.string(),
                         ": expected a calibration by Kalibr (cam0), OpenCV (camera_matrix) or RPG "
                         "(fx fy cx cy k1 k2 p1 p2 k3), found ",
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
  // At the very border the lens's axis has a picture to one side only, which cannot be undistorted.
  constexpr double kLeastMargin = 0.01;
  const auto inside = [](double place, int64_t size) {
    return place > kLeastMargin * double(size) && place < (1 - kLeastMargin) * double(size);
  };
  if (!(camera.fx > 0 && camera.fy > 0 && inside(camera.cx, width) && inside(camera.cy, height))) {
    throw DataError(concat(path, ": expected a principal point inside ", width, "x", height,
                           ", a hundredth of it from its borders, and focal lengths above 0, "
                           "found fx ",
                           camera.fx, ", fy ", camera.fy, ", cx ", camera.cx - 0.5, ", cy ",
                           camera.cy - 0.5, "; calibrate again"));
  }
  return {{camera.fx, camera.fy, camera.cx, camera.cy, width, height}, camera.lens};
}

}  // namespace jade::import
