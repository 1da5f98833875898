// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <torch/types.h>
#include <vector>

#include "jade/simulate/fixed_pattern.h"
#include "jade/simulate/options.h"
#include "jade/world/frame_source.h"

namespace jade::simulate {

/// Converts between stored values and linear light; both in [0,1].
float decode(float stored, Encoding encoding);
float encode(float linear, Encoding encoding);

/// Intensity at the event pixels, in stored values or light: 0.299 R + 0.587 G + 0.114 B, or with a
/// colour filter each pixel's own channel.
void event_intensity(const world::SharpFrame& frame, const ImageSensorOptions& image,
                     const EventSensorOptions& events, std::vector<float>& intensity);

/// Setting of a frame, relative to an exposure of exposure_ms without gain.
struct ExposureSetting {
  double time = 1;                                   ///< its length relative to exposure_ms
  double gain = 1;                                   ///< of the sensor
  double brightness() const { return time * gain; }  ///< of the frame relative to the scene
};

/// Integrates frames over one exposure; values between two frames are interpolated linearly.
class Exposing {
 public:
  Exposing(const ImageSensorOptions& options, int64_t width, int64_t height);
  /// Adds the part of the exposure from `before` to `after`.
  void add(const world::SharpFrame& before, const world::SharpFrame& after, double duration_us);
  /// The mean with photon and read noise, gain and fixed pattern, rounded to 8 bits: [3,H,W] in
  /// [0,1].
  torch::Tensor develop(uint64_t seed, const ExposureSetting& setting = {},
                        const FixedPattern* pattern = nullptr) const;
  /// The mean without noise and rounding, in stored values.
  torch::Tensor mean() const;

 private:
  ImageSensorOptions options_;
  int64_t width_, height_;
  bool in_light_;  // sums are of linear light
  double total_us_ = 0;
  std::vector<double> sum_;
};

/// A sharp frame as the 8-bit picture of a noiseless sensor.
torch::Tensor to_image(const world::SharpFrame& frame);

}  // namespace jade::simulate
