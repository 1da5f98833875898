// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "jade/gaussians/ply.h"
#include "jade/splat/gaussians.h"

namespace jade::gaussians {

struct SpzOptions {
  bool antialiased = false;
  /// Most bits after the binary point; the file has as many of them as its extent leaves of 24.
  int fractional_bits = 24;
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
/// which are in no picture, are omitted. Warns of positions that 24 bits resolve coarsely, and of
/// sizes beyond those that the format holds.
/// @param name  of the file, for messages
/// @throws DataError if a position is too far for 24 bits.
std::string encode_spz(const splat::Gaussians& gaussians, const SpzOptions& options = {},
                       const std::string& name = ".spz");

/// Writes the same to a file.
/// @throws DataError naming the path, also if the file cannot be written.
void write_spz(const std::filesystem::path& path, const splat::Gaussians& gaussians,
               const SpzOptions& options = {});

/// True if the bytes begin like a file of the format, gzipped or not.
bool is_spz(const std::string& bytes);

/// Decodes version 2, 3 or 4; omits SH beyond degree 3, with a note. Positions are rotated to this
/// library's axes.
/// @param name   of the file, for messages
/// @param notes  one line is appended for what is omitted
/// @throws DataError for damaged bytes, other versions and other files.
GaussianFile parse_spz(const std::string& bytes, const std::string& name,
                       std::vector<std::string>& notes);

}  // namespace jade::gaussians
