// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

namespace jade::imaging {

/// Header of an image file.
struct ImageHeader {
  int64_t width = 0, height = 0;
  bool has_alpha = false;   ///< an alpha channel, or a transparent colour
  int orientation = 1;      ///< EXIF orientation of a JPEG, 1 to 8; 1: shown as stored
  std::string values = {};  ///< kind of the values of a TIFF, as NumPy calls it: "float64"
};

/// Reads the header of a PNG, JPEG, TIFF, BMP, WebP or PNM file without decoding it; sizes as
/// stored, without rotation. No value for other, missing and damaged files, which read_image()
/// reports.
std::optional<ImageHeader> read_image_header(const std::filesystem::path& path);

}  // namespace jade::imaging
