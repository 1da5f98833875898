// SPDX-License-Identifier: Apache-2.0
#include "jade/import/calibration_matrix.h"

#include <algorithm>
#include <cmath>

#include "jade/core/error.h"

namespace jade::import {

using config::DocumentNode;

namespace {

using Names = std::vector<std::string>;
const Names kMatrixNames{"cameramatrix", "intrinsicmatrix", "k", "m"};
const Names kLensNames{
    "distortioncoefficients", "distortioncoeffs", "distcoeffs", "distcoeff", "distortion", "d"};
const Names kWidthNames{"imagewidth", "width"}, kHeightNames{"imageheight", "height"};
const Names kSizeNames{"imagesize", "resolution"};
const Names kModelNames{"distortionmodel", "distortiontype", "lensmodel",
                        "cameramodel",     "cameratype",     "projectionmodel"};

/// The first key of a map with one of these names; empty if it has none.
std::string key_among(const DocumentNode& node, const Names& names) {
  for (const std::string& name : names) {
    for (const auto& [key, value] : node.entries) {
      if (plain(key) == name) return key;
    }
  }
  return "";
}

Names marked(Names names, const std::string& mark) {
  const size_t count = names.size();
  for (size_t i = 0; i < count; ++i) names.push_back(mark + names[i]), names[i] += mark;
  return names;
}

}  // namespace

std::vector<CameraKeys> camera_keys(const DocumentNode& node) {
  std::vector<CameraKeys> out;
  for (const char* mark : {"", "0", "1", "2", "3", "left", "right"}) {
    const Names matrix = *mark ? marked(kMatrixNames, mark) : kMatrixNames;
    const std::string key = key_among(node, matrix);
    // k1 alone is a lens coefficient.
    if (key.empty() || node.find(key)->kind == DocumentNode::Kind::kText) continue;
    const std::string lens = key_among(node, *mark ? marked(kLensNames, mark) : kLensNames);
    out.push_back({key, lens.empty() ? "distortion_coefficients" : lens});
    if (!*mark) break;
  }
  return out;
}

namespace {

bool is_among(const std::string& word, const Names& names) {
  return std::find(names.begin(), names.end(), word) != names.end();
}

}  // namespace

LensKind lens_kind(const Section& section) {
  static const Names kFisheyes{"fisheye",        "equidistant",    "equi",       "kannalabrandt",
                               "kannalabrandt4", "kannalabrandt8", "kb4",        "kb8",
                               "opencvfisheye",  "fisheyeopencv",  "pinholeequi"};
  static const Names kPerspectives{
      "plumbbob", "rationalpolynomial", "radtan",       "radialtangential", "brown", "brownconrady",
      "opencv",   "fullopencv",         "pinholeradtan"};
  static const Names kOther{"omni", "mei", "ds", "eucm", "fov", "doublesphere", "omnidirectional"};
  static const Names kFlags{"0", "1", "false", "true", "no", "yes", "off", "on"};
  const auto is_value_of = [&](const std::vector<Names>& any) {
    return [any](const DocumentNode& node) {
      return node.kind == DocumentNode::Kind::kText &&
             std::any_of(any.begin(), any.end(),
                         [&](const Names& names) { return is_among(plain(node.text), names); });
    };
  };
  refuse_misspelt(section, kModelNames, is_value_of({kFisheyes, kPerspectives, kOther}));
  refuse_misspelt(section, {"fisheye", "isfisheye", "fisheyemodel"}, is_value_of({kFlags}));
  LensKind kind = LensKind::kUnsaid;
  std::string said_by;
  for (const auto& [key, node] : section.node.entries) {
    if (node.kind != DocumentNode::Kind::kText) continue;
    const std::string name = plain(key), value = plain(node.text);
    LensKind says = LensKind::kUnsaid;
    if (name.find("fisheye") != std::string::npos) {
      if (value.empty() || is_among(value, {"0", "false", "no", "off"})) continue;
      if (!is_among(value, {"1", "true", "yes", "on"})) {
        throw DataError(concat(section.where(key), ": expected 0 or 1, found '", node.text,
                               "'; write 1 for the four coefficients of a fisheye lens"));
      }
      says = LensKind::kFisheye;
    } else if (is_among(name, kModelNames)) {
      const bool of_lens = name.rfind("distortion", 0) == 0;
      if (is_among(value, kFisheyes)) {
        says = LensKind::kFisheye;
      } else if (is_among(value, kPerspectives)) {
        says = LensKind::kPerspective;
      } else if (of_lens && value == "none") {
        says = LensKind::kNone;
      } else if ((of_lens && !value.empty()) || is_among(value, kOther)) {
        // The value may also be a product name.
        throw DataError(concat(section.where(key),
                               ": expected plumb_bob, rational_polynomial or fisheye, found '",
                               node.text, "'; calibrate with one of these models"));
      }
    }
    if (says == LensKind::kUnsaid) continue;
    if (kind != LensKind::kUnsaid && kind != says) {
      throw DataError(concat(section.where(key), ": expected one model of the lens, found '",
                             node.text, "' beside ", said_by, "; keep the right one"));
    }
    kind = says, said_by = concat(key, " '", node.text, "'");
  }
  return kind;
}

namespace {

/// Rejects skew, binning and the like, which this program does not support.
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
  for (const char* const name : {"binningx", "binningy"}) {
    const std::string key = key_among(section.node, {name});
    if (key.empty()) continue;
    const double found = number(section, key, *section.node.find(key));
    if (found <= 1) continue;
    throw DataError(concat(section.where(key), ": expected 0 or 1, found ", found,
                           "; the matrix is that of the whole sensor, calibrate at the recording's "
                           "size"));
  }
}

/// Rejects a camera_info of a part of the sensor, of which the matrix is that of the whole.
void check_region(const Section& section, const CalibratedCamera& camera) {
  const DocumentNode* const roi = section.node.find("roi");
  if (roi == nullptr || roi->kind != DocumentNode::Kind::kMap) return;
  const Section region{section.path, "roi", *roi};
  const auto value = [&](const char* key) {
    const DocumentNode* const node = roi->find(key);
    return node == nullptr ? 0 : int64_t(number(region, key, *node));
  };
  const int64_t x = value("x_offset"), y = value("y_offset");
  const int64_t width = value("width"), height = value("height");
  const bool is_whole = (width == 0 || width == camera.width) &&
                        (height == 0 || height == camera.height) && x == 0 && y == 0;
  if (is_whole) return;
  throw DataError(concat(section.where("roi"), ": expected the whole image, found ", width, "x",
                         height, " px from (", x, ", ", y,
                         "); the matrix is that of the whole sensor, subtract the offsets from its "
                         "centre, set width and height, and remove roi"));
}

void read_size(const Section& section, CalibratedCamera& camera) {
  const auto side = [&](const Names& names, const char* usual) {
    const std::string found = key_among(section.node, names), key = found.empty() ? usual : found;
    return int64_t(number(section, key, require(section, key, "the size calibrated for")));
  };
  const std::string both = key_among(section.node, kSizeNames);
  if (!both.empty() && key_among(section.node, kWidthNames).empty()) {
    const auto size = numbers(section, both, "[width, height]", 2);
    camera.width = int64_t(size[0]), camera.height = int64_t(size[1]);
  } else {
    camera.width = side(kWidthNames, "image_width");
    camera.height = side(kHeightNames, "image_height");
  }
}

}  // namespace

CalibratedCamera matrix_camera(const Section& section, const CameraKeys& keys, LensKind around) {
  CalibratedCamera camera;
  camera.name = section.name;
  const auto matrix = numbers(section, keys.matrix, "a 3x3 camera matrix", 9);
  check_plain_camera(section, keys, matrix);
  camera.fx = matrix[0], camera.fy = matrix[4];
  camera.cx = matrix[2] + 0.5, camera.cy = matrix[5] + 0.5;
  read_size(section, camera);
  check_region(section, camera);
  const LensKind own = lens_kind(section), kind = own == LensKind::kUnsaid ? around : own;
  if (kind == LensKind::kNone) return camera;
  const bool is_fisheye = kind == LensKind::kFisheye;
  const std::string& key = keys.lens;
  const auto k = numbers(section, key, require(section, key, "the lens's coefficients"));
  if (k.empty()) return camera;
  const bool counts = is_fisheye ? k.size() == 4 : k.size() == 4 || k.size() == 5 || k.size() == 8;
  // OpenCV writes up to 14 coefficients; those after the eighth are thin-prism and tilt terms.
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

}  // namespace jade::import
