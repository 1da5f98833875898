// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "jade/gaussians/ply.h"

namespace jade::gaussians {

/// Writes the .sog format of PlayCanvas and SuperSplat, version 2: a zip archive of lossless WebP
/// images, one pixel per Gaussian, and a meta.json. Positions have 16 bits per axis, uniform in
/// sign(x) ln(1 + |x|); scales and colours are the nearest of 256 values; rotations and opacities
/// have 8 bits; SH beyond degree 0 are the nearest row of a palette with a quarter as many rows, at
/// most 65536. Gaussians are sorted along a space-filling curve. Those with a number that is not
/// finite are omitted.
/// @throws DataError naming the path.
void write_sog(const std::filesystem::path& path, const GaussianFile& file);

/// Reads version 2, as an archive or as its unpacked meta.json beside the images.
/// @throws DataError naming the path for damaged and other files.
GaussianFile read_sog(const std::filesystem::path& path);

}  // namespace jade::gaussians
