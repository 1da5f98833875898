// SPDX-License-Identifier: Apache-2.0
// A pattern that is fixed to the frame sensor, from the frames themselves.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/import/capture.h"

namespace jade::import {

/// Offsets and gains of pixels, rows, columns and dust. A frame without them is scale · I + offset.
struct SensorPattern {
  torch::Tensor scale, offset;  ///< [3,H,W] float32; undefined: no pattern was found
  /// Standard deviation of the additive part and of the multiplicative part, the latter as a part
  /// of the light; 0: none.
  double additive = 0, multiplicative = 0;
  std::string said;

  bool is_found() const { return scale.defined(); }
};

/// Finds a pattern in what frames have in common after I − G(I), with a Gaussian G of 8 px. The
/// model, additive or multiplicative, that leaves the smaller residual comes first, the other one
/// follows on what is left.
///
/// The scene that happens to be left in the mean of the frames is not taken for a pattern. Its
/// power at spatial frequency f follows from the power S(f) of single frames and the places p_k of
/// the picture in them, |mean_k exp(−2πi f·p_k)|² S(f), and a Wiener filter keeps what exceeds it.
/// Where this factor is above a half, nothing is kept. Spots of dust are told by standing out on
/// the same side of their surroundings in nine of ten frames.
/// @param frames  [3,H,W] of one size, by time; none is found in fewer than 8, in raw mosaics, and
///   where the picture's places spread by less than 8 px (root mean square)
/// @throws Interrupted.
SensorPattern find_sensor_pattern(const std::vector<torch::Tensor>& frames);

/// Takes the pattern out of the frames. White pixels are saturated and stay white.
void remove_sensor_pattern(const SensorPattern& pattern, Capture& capture);

/// Writes pattern.json and, where a pattern was found, pattern.npz. @throws DataError.
void keep_sensor_pattern(const std::filesystem::path& folder, const SensorPattern& pattern);
/// Reads what keep_sensor_pattern() wrote. @throws DataError naming the file.
SensorPattern load_sensor_pattern(const std::filesystem::path& folder);

}  // namespace jade::import
