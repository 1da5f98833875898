// SPDX-License-Identifier: Apache-2.0
// The compressed .ply of PlayCanvas, SuperSplat and gsplat. Private to this folder.
#pragma once

#include <string>

#include "jade/gaussians/ply_header.h"
#include "jade/splat/gaussians.h"

namespace jade::gaussians {

/// True if the vertices have packed_position, packed_rotation, packed_scale and packed_color.
bool is_packed(const PlyFile& file);

/// Decodes the packed vertices: 256 vertices share a row of the element 'chunk' with the ranges of
/// positions, log scales and, in newer files, colours; SH coefficients above the constant are bytes
/// of the element 'sh'. Opacities of 0 and 1 become infinite logits.
/// Format: developer.playcanvas.com, "Compressed PLY".
/// @throws DataError naming the path for files that lack a part of it.
splat::Gaussians unpack(const PlyFile& file);

/// Encodes Gaussians as the bytes of such a file, sorted along a space-filling curve so that those
/// of a chunk are near each other: positions and log scales in 11, 10 and 11 bits of their chunk's
/// range, colours and opacities in 8, rotations in 10 per component, SH in 8 bits from -4 to 4,
/// dithered, without the highest degrees that are 0 everywhere.
/// @param antialiased  as GaussianFile::antialiased
std::string encode_packed_ply(const splat::Gaussians& gaussians, bool antialiased);

}  // namespace jade::gaussians
