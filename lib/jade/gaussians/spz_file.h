// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

#include "jade/gaussians/ply.h"
#include "jade/splat/gaussians.h"

namespace jade::gaussians {

struct SpzOptions {
  bool antialiased = false;
  /// Bits after the binary point; fewer if the scene is too large for 24 bits.
  int fractional_bits = 12;
  /// Significant bits of the SH coefficients of degree 1 and of higher degrees; the file stores 8
  /// for each. Fewer bits compress better, and cause most of the format's loss.
  int first_degree_bits = 5, higher_degree_bits = 4;
  /// Version of the format: most viewers read 2; 3 and 4 store rotations more precisely, and 4
  /// compresses each attribute separately, with Zstandard.
  int version = 2;
};

/// Encodes the compressed .spz format, gzipped or, for version 4, in Zstandard streams: 24-bit
/// fixed-point positions, 8-bit scales, rotations, opacities and colours, SH up to degree 3 in as
/// many bits as the options say. Positions are rotated from this library's axes (x right, y down, z
/// forward) to the format's (x right, y up, z back). Gaussians with a number that is not finite,
/// which are in no picture, are omitted.
/// @throws DataError if a position is too far for 24 bits.
std::string encode_spz(const splat::Gaussians& gaussians, const SpzOptions& options = {});

/// Writes the same to a file.
/// @throws DataError naming the path, also if the file cannot be written.
void write_spz(const std::filesystem::path& path, const splat::Gaussians& gaussians,
               const SpzOptions& options = {});

/// True if the bytes begin like a file of the format, gzipped or not.
bool is_spz(const std::string& bytes);

/// Decodes version 2, 3 or 4; omits SH beyond degree 3, which version 4 allows. Positions are
/// rotated to this library's axes.
/// @param name  of the file, for messages
/// @throws DataError for damaged bytes, other versions and other files.
GaussianFile parse_spz(const std::string& bytes, const std::string& name);

}  // namespace jade::gaussians
