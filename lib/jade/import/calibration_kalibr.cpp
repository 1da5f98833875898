// SPDX-License-Identifier: Apache-2.0
#include "jade/import/calibration_kalibr.h"

#include "jade/core/error.h"
#include "jade/import/calibration_fields.h"

namespace jade::import {

using config::DocumentNode;

namespace {

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

}  // namespace

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

}  // namespace jade::import
