// SPDX-License-Identifier: Apache-2.0
// Variants of .ply that read_ply() reads, and those that it rejects.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "jade/core/words.h"
#include "jade/gaussians/ply.h"

namespace jade::gaussians {

/// Kind of a .ply, from the names of its elements and properties. A file with some attributes of
/// Gaussians counts as such even if others are missing; read_ply() then lists those.
enum class PlyKind {
  kGaussians,  ///< f_dc_0..2, opacity, scale_0..2, rot_0..3
  kColored,    ///< red, green, blue instead of f_dc (ns-export --ply-color-mode rgb)
  kFlat,       ///< only scale_0 and scale_1: the thickness is a thousandth of the thinner
  kPacked,     ///< ply_packed.h
  kPoints,
  kMesh
};

constexpr auto words_of(PlyKind) {
  return std::array{Word{"3DGS", PlyKind::kGaussians},
                    Word{"3DGS with the colours red, green, blue", PlyKind::kColored},
                    Word{"2DGS", PlyKind::kFlat},
                    Word{"compressed 3DGS (PlayCanvas, SuperSplat, gsplat)", PlyKind::kPacked},
                    Word{"point cloud", PlyKind::kPoints},
                    Word{"mesh", PlyKind::kMesh}};
}

/// @throws DataError as read_ply.
PlyKind kind_of(const std::filesystem::path& path);

/// Result of read_ply() with details of the file. A missing log scale, or one below the rendered
/// range (-30, so also minus infinity), becomes a thousandth of the Gaussian's thinnest other axis.
struct PlyScene {
  GaussianFile file;
  PlyKind kind = PlyKind::kGaussians;
  int64_t flat = 0;                ///< Gaussians whose thickness in the file is zero or missing
  std::vector<std::string> notes;  ///< changes made while reading, one line each
};

/// @throws DataError as read_ply; the message says what the file is, or which attributes are
///   missing.
PlyScene read_scene(const std::filesystem::path& path);

/// True if the vertices of read_point_cloud() have colours.
bool has_colors(const std::filesystem::path& path);

}  // namespace jade::gaussians
