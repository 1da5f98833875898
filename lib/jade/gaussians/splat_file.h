// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "jade/gaussians/ply.h"
#include "jade/splat/gaussians.h"

namespace jade::gaussians {

/// Writes the .splat format of web viewers, 32 bytes per Gaussian: position and scale (float32
/// each), RGBA (8 bits, from the DC colour and the opacity), quaternion wxyz (8 bits each, 128 +
/// 128 q). Sorted so that large, opaque Gaussians come first, because viewers render while they
/// load. The format cannot store SH beyond degree 0, which is dropped. Gaussians with a number that
/// is not finite, which are in no picture, are omitted.
/// @throws DataError if the file cannot be written.
void write_splat(const std::filesystem::path& path, const splat::Gaussians& gaussians);

/// Reads the same format, which has no signature, only records of 32 bytes.
/// @throws DataError naming the path for a file of another size.
GaussianFile read_splat(const std::filesystem::path& path);

}  // namespace jade::gaussians
