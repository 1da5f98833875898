// SPDX-License-Identifier: Apache-2.0
#include "jade/import/calibration_basalt.h"

#include <cmath>

#include "jade/core/error.h"
#include "jade/import/calibration_fields.h"

namespace jade::import {
namespace {

using config::DocumentNode;

/// The entry of a list in value0 for one camera. @throws DataError naming the list.
const DocumentNode& of_camera(const std::filesystem::path& path, const DocumentNode& value,
                              const char* key, size_t index) {
  const DocumentNode& list = require({path, "value0", value}, key, "one entry per camera");
  if (index < list.items.size()) return list.items[index];
  throw DataError(concat(path.string(), ": expected one entry of value0.", key,
                         " per camera, found ", list.items.size(), "; calibrate again"));
}

std::vector<double> values(const Section& section, std::initializer_list<const char*> keys) {
  std::vector<double> out;
  for (const char* key : keys)
    out.push_back(number(section, key, require(section, key, "a number")));
  return out;
}

CalibratedCamera camera_at(const std::filesystem::path& path, const DocumentNode& value,
                           const DocumentNode& entry, size_t index) {
  const std::string name = concat("value0.intrinsics[", index, "]");
  const std::string type = word({path, name, entry}, "camera_type");
  if (type != "kb4" && type != "pinhole" && type != "pinhole-radtan8") {
    throw DataError(concat(Section{path, name, entry}.where("camera_type"),
                           ": expected kb4, pinhole-radtan8 or pinhole, found '", type,
                           "'; calibrate with basalt_calibrate --cam-types kb4"));
  }
  const Section section{path, name, require({path, name, entry}, "intrinsics", "a map")};
  const auto matrix = values(section, {"fx", "fy", "cx", "cy"});
  CalibratedCamera camera;
  camera.name = concat("camera ", index);
  camera.fx = matrix[0], camera.fy = matrix[1];
  camera.cx = matrix[2] + 0.5, camera.cy = matrix[3] + 0.5;
  const auto size =
      numbers({path, name, entry}, "resolution", of_camera(path, value, "resolution", index));
  if (size.size() != 2) {
    throw DataError(concat(path.string(), ": expected value0.resolution to be [width, height], ",
                           "found ", size.size(), " numbers; calibrate again"));
  }
  camera.width = int64_t(size[0]), camera.height = int64_t(size[1]);
  if (type == "kb4") camera.lens = fisheye(values(section, {"k1", "k2", "k3", "k4"}));
  if (type != "pinhole-radtan8") return camera;
  const auto k = values(section, {"k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"});
  camera.lens = checked(radial_tangential(k), k);
  return camera;
}

/// The pose imu_from_camera.
geometry::Pose pose_at(const std::filesystem::path& path, const DocumentNode& value, size_t index) {
  const Section section{path, concat("value0.T_imu_cam[", index, "]"),
                        of_camera(path, value, "T_imu_cam", index)};
  const auto p = values(section, {"px", "py", "pz"});
  const auto q = values(section, {"qw", "qx", "qy", "qz"});
  const double norm = std::hypot(std::hypot(q[0], q[1]), std::hypot(q[2], q[3]));
  if (std::abs(norm - 1) > 1e-3) {
    throw DataError(concat(section.where("qw"), ": expected a quaternion of length 1, found ", norm,
                           "; calibrate again"));
  }
  geometry::Pose pose;
  pose.rotation = geometry::rotation_from_quaternion({q[0], q[1], q[2], q[3]});
  pose.translation = {p[0], p[1], p[2]};
  return pose;
}

}  // namespace

const DocumentNode* basalt_intrinsics(const DocumentNode& root) {
  const DocumentNode* const value = root.find("value0");
  const DocumentNode* const list = value == nullptr ? nullptr : value->find("intrinsics");
  const bool is_list = list != nullptr && list->kind == DocumentNode::Kind::kList;
  return is_list && !list->items.empty() ? list : nullptr;
}

Calibration read_basalt(const std::filesystem::path& path, const DocumentNode& intrinsics,
                        const DocumentNode& root) {
  const DocumentNode& value = *root.find("value0");
  Calibration out{path, {}, {}};
  for (size_t i = 0; i < intrinsics.items.size(); ++i) {
    if (i < 2) {
      out.cameras.push_back(camera_at(path, value, intrinsics.items[i], i));
    } else {
      out.unused.push_back(concat("camera ", i));
    }
  }
  if (out.cameras.size() == 2)
    out.second_from_first =
        geometry::compose(geometry::inverse(pose_at(path, value, 1)), pose_at(path, value, 0));
  return out;
}

}  // namespace jade::import
