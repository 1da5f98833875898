// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <torch/types.h>

namespace jade::geometry {

/// A pinhole camera. Pixel (column i, row j) has its centre at projection coordinates
/// (i + 0.5, j + 0.5): u = fx x/z + cx, and cx = width/2 is the middle of the image.
/// Calibrations that put pixel centres on integers (OpenCV, Kalibr) need cx and cy raised by 0.5.
struct Intrinsics {
  double fx = 0, fy = 0, cx = 0, cy = 0;  ///< px
  int64_t width = 0, height = 0;          ///< px

  /// Square pixels and a centred principal point.
  static Intrinsics centred(double focal_px, int64_t width, int64_t height);
};

bool operator==(const Intrinsics& a, const Intrinsics& b);
bool operator!=(const Intrinsics& a, const Intrinsics& b);

/// The camera for its view resampled to `width` x `height` pixels.
Intrinsics scaled(const Intrinsics& camera, int64_t width, int64_t height);

/// Projection coordinates (u, v) of a point in camera axes (x right, y down, z forward). z > 0.
std::array<double, 2> project(const Intrinsics& camera, const std::array<double, 3>& point);

/// Direction in camera axes, with z = 1, that projects to (u, v).
std::array<double, 3> unproject(const Intrinsics& camera, double u, double v);

/// [4] float64: fx, fy, cx, cy in pixels.
torch::Tensor to_tensor(const Intrinsics& camera);

/// Throws ContractError, naming `what`, unless focal lengths and sizes are positive and finite.
void check_camera(const Intrinsics& camera, const std::string& what);

}  // namespace jade::geometry
