// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <torch/types.h>

#include "jade/geometry/camera.h"

namespace jade::geometry {

/// Radial and tangential lens distortion, in OpenCV's order and sign. At (x, y) on the plane z = 1,
///     x' = x r + 2 p1 x y + p2 (ρ + 2x²),  y' = y r + p1 (ρ + 2y²) + 2 p2 x y,
///     ρ = x² + y²,  r = 1 + k1 ρ + k2 ρ² + k3 ρ³.
struct Distortion {
  double k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0;
};

/// Where the lens puts the direction (x, y, 1).
std::array<double, 2> distort(const Distortion& lens, double x, double y);

/// The direction that the lens puts at (x, y): the inverse by Newton's method, NaN where the lens
/// folds and there is none nearby.
std::array<double, 2> undistort(const Distortion& lens, double x, double y);

// Maps hold pixel indices: (3, 5) is the middle of column 3 and row 5, (3.5, 5.5) for project().

/// For frames: where in the raw image the content of each rectified pixel lies.
/// @return [2,H,W] float32 at the rectified size, column then row.
torch::Tensor undistortion_map(const Intrinsics& raw, const Distortion& lens,
                               const Intrinsics& rectified);

/// For events: where in the rectified image each raw pixel goes; the inv_mapx and inv_mapy of
/// ev_map.npz.
/// @return [2,H,W] float32 at the raw size, column then row; NaN where the lens has no inverse.
torch::Tensor rectification_map(const Intrinsics& raw, const Distortion& lens,
                                const Intrinsics& rectified);

/// Bilinear samples of an image at a map's places; beside the image, its nearest edge.
/// @param image  [C,H,W] float32 on the CPU
/// @param map    [2,h,w] float32
/// @return [C,h,w]; 0 where the map is NaN.
torch::Tensor sample(const torch::Tensor& image, const torch::Tensor& map);

}  // namespace jade::geometry
