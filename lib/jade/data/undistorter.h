// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/data/warnings.h"
#include "jade/geometry/lens.h"

namespace jade::data {

/// Whether the principal point lies inside the image, a hundredth of it from its borders. Nearer to
/// the border, the lens's axis has a picture to one side only, which cannot be undistorted.
bool principal_point_inside(const geometry::Intrinsics& camera);

/// @param what  the camera, for messages
/// @throws DataError for a principal point farther outside of the image than its size, and for
/// focal lengths beyond 1/20
///   to 100 times the larger side of the image.
void check_plausible(const geometry::Intrinsics& camera, const std::string& what);

/// The camera at the size of its picture.
/// @param what  the camera, for messages
/// @throws DataError naming both sizes where the picture has not the camera's shape: one of the two
///   was turned, cropped or padded; and as check_plausible().
geometry::Intrinsics fit_to_picture(const geometry::Intrinsics& camera, int64_t width,
                                    int64_t height, const std::string& what);

/// How far, in px, a lens moves the border of its picture from where a pinhole of the same focal
/// lengths has it; infinite where that pinhole sees what the lens does not.
double lens_shift_px(const geometry::LensCamera& camera);

/// Brings frames that were taken through lenses to pinholes of the same size, focal lengths and
/// principal point. Pixels for which the lens has no content become black and are masked. A lens
/// that moves nothing by more than a pixel is left as it is, which is told.
class Undistorter {
 public:
  /// @param image  [3,H,W] at the size of the camera; undistorted in place of itself
  /// @param mask   as Exposure::mask; stays undefined where every pixel has content
  /// @param what   the camera, for messages
  /// @throws DataError for a lens that has content for no pixel.
  geometry::Intrinsics undistort(const geometry::LensCamera& camera, const std::string& what,
                                 torch::Tensor& image, torch::Tensor& mask);

  /// Adds to the warnings what was ignored, and to the notes what was done.
  void tell(const Warnings& warnings, std::vector<std::string>& notes) const;

 private:
  struct Straight {
    geometry::LensCamera camera;
    double shift_px = 0;
    torch::Tensor map;     ///< [2,H,W]; undefined: the lens is left as it is
    torch::Tensor inside;  ///< [1,H,W] bool: has content
  };
  const Straight& straight(const geometry::LensCamera& camera, const std::string& what);

  std::vector<Straight> known_;  ///< of the latest cameras
  std::vector<std::string> ignored_, undistorted_;
  double most_ignored_px_ = 0, most_undistorted_px_ = 0;
  double masked_ = 0, pixels_ = 0;
};

/// Moves all events, recorded through the lens of the frames, to the pinhole of undistort(), the
/// exposures' slices and the colours of event pixels with them. Does nothing for a lens that
/// undistort() leaves as it is. Events that leave the image are dropped.
void undistort_events(const geometry::LensCamera& camera, Dataset& data);

}  // namespace jade::data
