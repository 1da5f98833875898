// SPDX-License-Identifier: Apache-2.0
// Rectifies a camera with a lens to a centred pinhole.
#pragma once

#include <torch/types.h>

#include "jade/core/words.h"
#include "jade/geometry/lens.h"

namespace jade::geometry {

/// Part of the lens camera's field of view that the pinhole shows.
enum class RectifiedField { kFilled, kWhole };

constexpr auto words_of(RectifiedField) {
  return std::array{Word{"filled", RectifiedField::kFilled,
                         "the widest view without black borders; the corners of a barrel are lost"},
                    Word{"whole", RectifiedField::kWhole,
                         "all that the lens sees up to 70 degrees off its axis; black borders"}};
}

/// The pinhole of the same size, with square pixels and a centred principal point, that shows the
/// requested field. The border pixels determine the focal length.
/// @throws ContractError for a lens that covers nothing around its axis.
Intrinsics rectified_camera(const LensCamera& raw, RectifiedField field);

// Maps contain pixel indices: (3, 5) is the centre of column 3 and row 5, (3.5, 5.5) for project().

/// For frames: the place in the raw image of each rectified pixel's content.
/// @return [2,H,W] float32 at the rectified size, column then row; NaN if the lens has no content
///   there.
torch::Tensor undistortion_map(const LensCamera& raw, const Intrinsics& rectified);

/// For events: the place in the rectified image of each raw pixel; the inv_mapx and inv_mapy of
/// ev_map.npz.
/// @return [2,h,w] float32 at the raw size, column then row; NaN if the lens has no inverse, or one
///   behind the pinhole.
torch::Tensor rectification_map(const LensCamera& raw, const Intrinsics& rectified);

/// A second camera beside the first.
struct Rig {
  LensCamera second;
  Pose second_from_first;  ///< x_second = R x_first + t, in the unit of the plane's depth
};

/// x_second ~ H x_first for directions with z = 1 and points on the plane z = depth of the first
/// camera: H = R + t (0, 0, 1) / depth.
Matrix3 plane_homography(const Pose& second_from_first, double depth);

/// rectification_map from the second camera's pixels to the first camera's pinhole `rectified`,
/// exact on the plane z = depth of the first camera.
torch::Tensor plane_map(const Rig& rig, const Intrinsics& rectified, double depth);

/// Error of plane_map for content at another depth, px.
struct Parallax {
  double mean_px = 0, largest_px = 0;
};

/// Over a grid of pixels of `rectified`, for content at depth `actual` that plane_map() maps by the
/// plane at `depth`. Both in the unit of the rig's translation.
Parallax plane_parallax(const Rig& rig, const Intrinsics& rectified, double depth, double actual);

}  // namespace jade::geometry
