// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "jade/gaussians/ply.h"

namespace jade::gaussians {

/// Writes the .sog format of PlayCanvas and SuperSplat, version 2: a zip archive of lossless WebP
/// images, a pixel per Gaussian, and a meta.json. Positions have 16 bits per axis, evenly over
/// sign(x) ln(1 + |x|); scales and colours are the nearest of 256; rotations and opacities have 8
/// bits; SH beyond degree 0 are the nearest of a palette of a quarter as many rows, at most 65536.
/// Gaussians lie along a curve in space. Those with a number that is not finite are left out.
/// @throws DataError naming the path.
void write_sog(const std::filesystem::path& path, const GaussianFile& file);

/// Reads version 2, as an archive or as its unpacked meta.json beside the images.
/// @throws DataError naming the path for damaged and other files.
GaussianFile read_sog(const std::filesystem::path& path);

}  // namespace jade::gaussians
