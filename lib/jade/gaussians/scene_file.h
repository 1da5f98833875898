// SPDX-License-Identifier: Apache-2.0
// Gaussians from and to files of every kind that we know.
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

/// The endings of the files that read_scene_file() reads, for messages and help.
inline constexpr char kReadEndings[] = ".ply, .spz, .sog, .glb, .gltf or .splat";
/// And those that write_scene_file() writes.
inline constexpr char kWrittenEndings[] = ".ply, .compressed.ply, .spz, .sog, .glb or .splat";

/// Kind of a file, by its first bytes, or, where these tell nothing, by its ending. Nothing for a
/// folder, a file that is missing and one of another kind.
std::optional<SceneKind> scene_kind(const std::filesystem::path& path);

/// @throws DataError with what to do for Gaussians of a kind that is known and not read, and for a
/// file of a known ending that was not fetched or not unpacked. Other paths pass.
void refuse_foreign_scene(const std::filesystem::path& path);

/// Gaussians and what their file is.
struct SceneFile {
  GaussianFile file;
  std::string kind;                ///< for people, such as "3DGS" or ".spz"
  int64_t flat = 0;                ///< Gaussians whose thickness the file has as zero or not at all
  std::vector<std::string> notes;  ///< one line each, naming the path
};

/// Reads a file of any kind. Means far from the origin are moved to one of their own.
/// @throws DataError naming the path, and what the file is if it is of none.
SceneFile read_scene_file(const std::filesystem::path& path);

/// The Gaussians alone; the notes are logged as warnings.
GaussianFile read_gaussians(const std::filesystem::path& path);

struct SceneWriting {
  PlyCoordinates coordinates = PlyCoordinates::kOwn;  ///< .ply only
  int spz_version = 2;
};

/// True where write_scene_file() knows the ending of the path.
bool can_write(const std::filesystem::path& path);

/// True where the path names a .ply that holds all numbers as they are.
bool is_exact(const std::filesystem::path& path);

/// Writes what the ending of the path says. All but .ply leave out what cannot be drawn.
/// @throws DataError naming the path. @pre can_write(path)
void write_scene_file(const std::filesystem::path& path, const GaussianFile& file,
                      const SceneWriting& writing = {});

}  // namespace jade::gaussians
