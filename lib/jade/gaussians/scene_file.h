// SPDX-License-Identifier: Apache-2.0
// Reads and writes files of Gaussians in all supported formats.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "jade/core/words.h"
#include "jade/gaussians/ply.h"

namespace jade::gaussians {

enum class SceneKind { kPly, kSpz, kSog, kGltf, kSplat };

constexpr auto words_of(SceneKind) {
  return std::array{Word{"ply", SceneKind::kPly}, Word{"spz", SceneKind::kSpz},
                    Word{"sog", SceneKind::kSog}, Word{"gltf", SceneKind::kGltf},
                    Word{"splat", SceneKind::kSplat}};
}

/// Extensions of the files that read_scene_file() reads, for messages and help.
inline constexpr char kReadEndings[] = ".ply, .spz, .sog, .glb, .gltf or .splat";
/// Extensions of the files that write_scene_file() writes.
inline constexpr char kWrittenEndings[] = ".ply, .compressed.ply, .spz, .sog, .glb or .splat";

/// Format of a file, by its first bytes or, if these are inconclusive, by its extension. No value
/// for a folder, a missing file and other formats.
std::optional<SceneKind> scene_kind(const std::filesystem::path& path);

/// @throws DataError with what to do for Gaussians in a known format that is not supported, and for
///   a file with a known extension that was not fetched or not unpacked. Returns for other paths.
void refuse_foreign_scene(const std::filesystem::path& path);

/// Gaussians and details of their file.
struct SceneFile {
  GaussianFile file;
  std::string kind;                ///< format for people, such as "3DGS" or ".spz"
  int64_t flat = 0;                ///< Gaussians whose thickness in the file is zero or missing
  std::vector<std::string> notes;  ///< one line each, naming the path
};

/// Reads a file in any supported format. Means far from the origin are moved to an origin near
/// them.
/// @throws DataError naming the path, and what the file is if its format is not supported.
SceneFile read_scene_file(const std::filesystem::path& path);

/// Returns only the Gaussians; logs the notes as warnings.
GaussianFile read_gaussians(const std::filesystem::path& path);

struct SceneWriting {
  PlyCoordinates coordinates = PlyCoordinates::kOwn;  ///< .ply only
  int spz_version = 2;
};

/// True if write_scene_file() supports the extension of the path.
bool can_write(const std::filesystem::path& path);

/// True if the path names a .ply that stores all numbers exactly.
bool is_exact(const std::filesystem::path& path);

/// Writes the format of the path's extension. All formats but .ply omit Gaussians that cannot be
/// rendered. Warns of colours that the format clips or leaves out.
/// @throws DataError naming the path.
/// @pre can_write(path)
void write_scene_file(const std::filesystem::path& path, const GaussianFile& file,
                      const SceneWriting& writing = {});

}  // namespace jade::gaussians
