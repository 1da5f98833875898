// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

namespace jade::imaging {

/// The pixels of a PGM or PPM file as stored: rows of gray values or RGB.
struct Pnm {
  int64_t width = 0, height = 0;
  int64_t channels = 1;          ///< 1 or 3
  int64_t white = 0;             ///< value of white (maxval) in the header, 1 to 65535
  std::vector<uint16_t> values;  ///< height × width × channels; may exceed `white` in faulty files
};

/// Reads the first picture of a PGM or PPM file, as text or bytes (P2, P3, P5, P6). No value for
/// other files. OpenCV ignores the white level of some of these kinds.
/// @throws DataError for a header without sizes or white level, and too few pixels.
std::optional<Pnm> read_pnm(const std::filesystem::path& path);

}  // namespace jade::imaging
