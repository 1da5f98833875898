// SPDX-License-Identifier: Apache-2.0
// Estimates the light falloff of the lens towards the image corners from tracks of points.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/import/capture.h"
#include "jade/import/latents.h"
#include "jade/import/structure_from_motion.h"

namespace jade::import {

/// Brightness of one point of the scene in one image.
struct BrightnessSample {
  int64_t point = 0, shot = 0;
  double radius = 0;  ///< distance from the image centre; 1: the corners
  double log_brightness = 0;
};

/// Transmitted share of the light at radius r: v(r) = exp(a1 r² + a2 r⁴ + a3 r⁶), constant from
/// `reach` on.
struct Vignetting {
  std::array<double, 3> terms{};  ///< a1, a2, a3
  double reach = 0;               ///< largest radius with samples; 0: no vignetting was found
  double error = 0;               ///< standard error of log v(reach)
  int64_t samples = 0;
  std::string said;

  bool is_found() const { return reach > 0; }
  double at(double radius) const;
};

/// Fits log brightness = s(point) + log v(radius) + g(shot) by Huber's robust least squares. The
/// points' own brightness s is eliminated. A fit of three terms that is not monotonic or not
/// significant is repeated with two, then with one.
/// @return none (reach 0) if v(reach) is above 97 % or less than six standard errors below 1.
///   Errors of one point count as dependent.
Vignetting fit_vignetting(const std::vector<BrightnessSample>& samples);

/// Samples the sharp images in LATENTS/images at the points visible in each, over 3x3 px of the
/// shots. Ignores values near black or white and masked pixels.
std::vector<BrightnessSample> sample_brightness(const Capture& capture, const Reconstruction& found,
                                                const std::vector<LatentImage>& images,
                                                const std::filesystem::path& latents);

/// v at each pixel, [H,W] float64; the radius is 1 at the outer corners of the corner pixels.
torch::Tensor vignetting_map(const Vignetting& vignetting, int64_t height, int64_t width);

/// Divides the frames by v and clamps to white, so that saturated pixels stay white. Events are
/// unchanged: v is constant in time and cancels in differences of log intensity.
void remove_vignetting(const Vignetting& vignetting, Capture& capture);

/// Writes vignetting.json. @throws DataError.
void keep_vignetting(const std::filesystem::path& folder, const Vignetting& vignetting);
/// Reads the file that keep_vignetting() wrote. @throws DataError naming the file.
Vignetting load_vignetting(const std::filesystem::path& folder);

}  // namespace jade::import
