// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "jade/geometry/lens.h"
#include "jade/geometry/pose.h"

namespace jade::import {

/// A camera as in a calibration file.
struct CalibratedCamera {
  std::string name;   ///< "cam0", or empty
  std::string topic;  ///< of its ROS messages, or empty
  /// Principal point plus 0.5 px: the files put pixel centres on integers, this library does not.
  double fx = 0, fy = 0, cx = 0, cy = 0;
  int64_t width = 0, height = 0;  ///< 0: not in the file
  geometry::Lens lens;
};

/// One camera, or two: then with the second's pose relative to the first, in metres as in Kalibr.
struct Calibration {
  std::filesystem::path path;
  std::vector<CalibratedCamera> cameras;
  std::optional<geometry::Pose> second_from_first;
  std::vector<std::string> unused = {};  ///< further cameras of a chain
};

/// Reads the camera chain of Kalibr (`cam0`, `cam1`, not further ones: camera_model pinhole,
/// distortion_model radtan, equidistant or none, T_cn_cnm1), the FileStorage of OpenCV as YAML or
/// XML and its ROS variant (camera_matrix, distortion_coefficients or fisheye's four with
/// distortion_model, image_width, image_height, also as cameraMatrix, distCoeffs, K, D, in any
/// case; fisheye_model: 1 too), a camera_info message as ROS prints it (K and D, or k and d), one
/// camera of DV (a section of such a storage, or the JSON of dv-processing), the JSON of basalt
/// (value0: kb4, pinhole or pinhole-radtan8, one camera or two), or calib.txt of the RPG data sets
/// (fx fy cx cy, alone or with k1 k2 p1 p2 [k3]). The content determines the format.
/// @throws DataError: one line with the path, what was expected, what was found.
Calibration read_calibration(const std::filesystem::path& path);

/// Puts the camera of the frames first if there are two: by their sizes, else by their topics;
/// without either, the order stays.
/// @param width,height  of the frames
/// @return a warning about an exchange or a doubt; empty if there is none
std::string put_frames_first(Calibration& calibration, int64_t width, int64_t height);

/// The error of read_calibration() behind the path and without the remedy: ": expected …, found …";
/// empty for a calibration that can be read.
std::string calibration_fault(const std::filesystem::path& path);

/// The camera at `index` for pictures of this size.
/// @param what  for the message: "frames", "events"
/// @throws DataError if the calibration is for another size, its principal point lies outside, or
///   its focal lengths are those of no camera.
geometry::LensCamera camera_of(const Calibration& calibration, size_t index, int64_t width,
                               int64_t height, const std::string& what);

}  // namespace jade::import
