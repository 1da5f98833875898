// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

#include "jade/gaussians/ply.h"
#include "jade/splat/gaussians.h"

namespace jade::gaussians {

struct SpzOptions {
  bool antialiased = false;
  /// Fixed-point bits after the binary point, lowered where the scene is too large for 24 bits.
  int fractional_bits = 12;
  /// Bits of the SH coefficients of degree 1 and of those beyond, of the 8 that each has in the
  /// file: fewer pack better, and are most of what the format loses.
  int first_degree_bits = 5, higher_degree_bits = 4;
  /// Version of the format: most viewers read 2; 3 and 4 hold rotations finer, and 4 packs each
  /// attribute by itself, with Zstandard.
  int version = 2;
};

/// The compressed .spz format, gzipped or, of version 4, in Zstandard streams: 24-bit fixed-point
/// positions, 8-bit scales, rotations, opacities and colours, SH up to degree 3 in as many bits as
/// the options say. Positions are turned from our axes (x right, y down, z forward) to the format's
/// (x right, y up, z back). Gaussians with a number that is not finite, which are in no picture,
/// are left out.
/// @throws DataError where a position is too far for 24 bits.
std::string encode_spz(const splat::Gaussians& gaussians, const SpzOptions& options = {});

/// Writes the same as a file.
/// @throws DataError naming the path, also if the file cannot be written.
void write_spz(const std::filesystem::path& path, const splat::Gaussians& gaussians,
               const SpzOptions& options = {});

/// True where the bytes begin as a file of the format does, gzipped or not.
bool is_spz(const std::string& bytes);

/// Decodes version 2, 3 or 4; SH beyond degree 3, which version 4 can have, are left out. Positions
/// are turned to our axes.
/// @param name  stands for the file in messages
/// @throws DataError for damaged bytes, other versions and other files.
GaussianFile parse_spz(const std::string& bytes, const std::string& name);

}  // namespace jade::gaussians
