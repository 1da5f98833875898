// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "jade/splat/gaussians.h"

namespace jade::gaussians {

struct SpzOptions {
  bool antialiased = false;
  /// Fixed-point bits after the binary point, lowered where the scene is too large for 24 bits.
  int fractional_bits = 12;
};

/// Writes the compressed .spz format, version 2 (gzip): 24-bit fixed-point positions, 8-bit scales,
/// rotations, opacities and colours, SH up to degree 3 in 5 (degree 1) and 4 bits. Positions are
/// turned from our axes (x right, y down, z forward) to the format's (x right, y up, z back).
/// @throws DataError if the file cannot be written, or a position is not finite.
void write_spz(const std::filesystem::path& path, const splat::Gaussians& gaussians,
               const SpzOptions& options = {});

}  // namespace jade::gaussians
