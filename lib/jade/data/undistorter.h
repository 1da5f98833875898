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

/// Whether the principal point lies inside the image, at least a hundredth of its size from the
/// border. Nearer to the border, the image covers only one side of the lens's axis and cannot be
/// undistorted.
bool principal_point_inside(const geometry::Intrinsics& camera);

/// @param what  the camera, for messages
/// @throws DataError for a principal point farther outside the image than the image's size, and for
///   focal lengths beyond 1/20 to 100 times the larger side of the image.
void check_plausible(const geometry::Intrinsics& camera, const std::string& what);

/// The camera scaled to the size of its picture.
/// @param what  the camera, for messages
/// @throws DataError naming both sizes if their aspect ratios differ, because one of the two was
///   rotated, cropped or padded; and as check_plausible().
geometry::Intrinsics fit_to_picture(const geometry::Intrinsics& camera, int64_t width,
                                    int64_t height, const std::string& what);

/// A note for a picture whose size is neither a multiple nor a fraction of the camera's by a whole
/// number, as cropped pictures have; empty for others.
std::string scale_note(const geometry::Intrinsics& camera, int64_t width, int64_t height,
                       const std::string& what);

/// How far, in px, a lens moves the border of its picture relative to a pinhole of the same focal
/// lengths; infinite if the pinhole sees more than the lens.
double lens_shift_px(const geometry::LensCamera& camera);

/// Undistorts frames to pinholes of the same size, focal lengths and principal point. Pixels that
/// the lens does not cover become black and are masked. A lens that moves nothing by more than a
/// pixel is left as it is, with a note.
class Undistorter {
 public:
  /// @param image  [3,H,W] at the size of the camera; replaced by the undistorted image
  /// @param mask   as Exposure::mask; stays undefined if every pixel has content
  /// @param what   the camera, for messages
  /// @throws DataError for a lens that covers no pixel.
  geometry::Intrinsics undistort(const geometry::LensCamera& camera, const std::string& what,
                                 torch::Tensor& image, torch::Tensor& mask);

  /// Whether it has changed an image.
  bool has_undistorted() const { return !undistorted_.empty(); }

  /// Adds ignored parts to the warnings, and changes to the notes.
  void tell(const Warnings& warnings, std::vector<std::string>& notes) const;

 private:
  struct Straight {
    geometry::LensCamera camera;
    double shift_px = 0;
    torch::Tensor map;     ///< [2,H,W]; undefined: the lens is left as it is
    torch::Tensor inside;  ///< [1,H,W] bool: has content
  };
  const Straight& straight(const geometry::LensCamera& camera, const std::string& what);

  std::vector<Straight> known_;  ///< maps of the latest cameras
  std::vector<std::string> ignored_, undistorted_;
  double most_ignored_px_ = 0, most_undistorted_px_ = 0;
  double masked_ = 0, pixels_ = 0;
};

/// Moves all events, recorded through the lens of the frames, to the pinhole of undistort(), and
/// updates the exposures' slices and the colours of event pixels. Does nothing for a lens that
/// undistort() leaves as it is. Drops events that leave the image.
void undistort_events(const geometry::LensCamera& camera, Dataset& data);

}  // namespace jade::data
