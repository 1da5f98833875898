// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "jade/gaussians/ply.h"
#include "jade/splat/gaussians.h"

namespace jade::gaussians {

/// Writes the .splat format of web viewers, 32 bytes per Gaussian: position and scale (float32
/// each), RGBA (8 bits, from the DC colour and the opacity), quaternion wxyz (8 bits each, 128 +
/// 128 q). Sorted so that large, opaque Gaussians come first, since viewers draw while they load.
/// View dependence (SH beyond degree 0) has no place in the format and is dropped, and so are
/// Gaussians with a number that is not finite, which are in no picture.
/// @throws DataError if the file cannot be written.
void write_splat(const std::filesystem::path& path, const splat::Gaussians& gaussians);

/// Reads the same; the format has no mark by which to know it, only records of 32 bytes.
/// @throws DataError naming the path for a file of another size.
GaussianFile read_splat(const std::filesystem::path& path);

}  // namespace jade::gaussians
