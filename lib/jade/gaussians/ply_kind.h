// SPDX-License-Identifier: Apache-2.0
// The kinds of .ply that read_ply() reads besides the plain one, and those that it refuses.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "jade/core/words.h"
#include "jade/gaussians/ply.h"

namespace jade::gaussians {

/// Kind of a .ply, by the names of its elements and properties. A file with some attributes of
/// Gaussians counts as such even if others are missing, which read_ply() then names.
enum class PlyKind {
  kGaussians,  ///< f_dc_0..2, opacity, scale_0..2, rot_0..3
  kColored,    ///< red, green, blue instead of f_dc (ns-export --ply-color-mode rgb)
  kFlat,       ///< scale_0 and scale_1 alone: the thickness is a thousandth of the thinner
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

/// Result of read_ply() and its source. A missing log scale, or one below the rendered range (-30,
/// so also minus infinity), becomes a thousandth of the Gaussian's thinnest other axis.
struct PlyScene {
  GaussianFile file;
  PlyKind kind = PlyKind::kGaussians;
  int64_t flat = 0;                ///< Gaussians whose thickness the file has as zero or not at all
  std::vector<std::string> notes;  ///< one line each: what was changed while reading
};

/// @throws DataError as read_ply; it says what the file is, or which attributes are missing.
PlyScene read_scene(const std::filesystem::path& path);

/// True where the vertices of read_point_cloud() have colours.
bool has_colors(const std::filesystem::path& path);

}  // namespace jade::gaussians
