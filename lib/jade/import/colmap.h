// SPDX-License-Identifier: Apache-2.0
// Runs COLMAP as a process: the program, or the package pycolmap through scripts/colmap.py.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "jade/geometry/camera.h"

namespace jade::import {

/// The command prefix of COLMAP: the program `wanted`, else the package pycolmap through
/// scripts/colmap.py, which needs a quarter of the CPU time of Debian 12's program, else colmap on
/// PATH.
/// @throws DataError with the command that installs it.
std::vector<std::string> find_colmap(const std::filesystem::path& wanted);

/// Settings that all attempts for one set of images share.
struct ColmapJob {
  std::vector<std::string> program;  ///< find_colmap()
  std::filesystem::path images;      ///< folder
  int64_t count = 0;                 ///< number of images in it
  /// Camera of all images, at their size, held constant; no value: COLMAP estimates the focal
  /// length, and the principal point is the image centre.
  std::optional<geometry::Intrinsics> camera;
  /// Image of the same size, black where COLMAP must not find features; empty: none.
  std::filesystem::path mask;
  /// Folder with one such image per image, IMAGE.png.png for IMAGE.png; empty: none.
  std::filesystem::path own_masks;
  /// Pairs of image names to match; empty: all pairs.
  std::vector<std::pair<std::string, std::string>> pairs;
};

/// Additional flags, in COLMAP's spelling up to 3.12.
struct ColmapSettings {
  std::string name;  ///< name of the attempt and of its folder
  std::vector<std::string> extraction, matching, mapping;
  /// Without a camera: keeps the focal length that COLMAP starts with, in most runs 1.2 times the
  /// larger side of the image.
  bool hold_focal_length = false;
};

/// Extracts and matches features. Writes FOLDER/database.db and FOLDER/colmap.log. Shows progress.
/// @throws DataError with COLMAP's last output if it fails, Interrupted.
void match_features(const ColmapJob& job, const ColmapSettings& settings,
                    const std::filesystem::path& folder);

/// Reconstructs from FOLDER/database.db all images at once with the global mapper of COLMAP 4, into
/// FOLDER/NAME_global.
/// @return the folders of all resulting models, none if this COLMAP has no such mapper or it fails
std::vector<std::filesystem::path> reconstruct_globally(const ColmapJob& job,
                                                        const ColmapSettings& settings,
                                                        const std::filesystem::path& folder);

/// Reconstructs incrementally from FOLDER/database.db, several times at once, into FOLDER/NAME_0
/// and so on.
/// @return the folders of all resulting models, none if no initial pair of images was found
std::vector<std::filesystem::path> reconstruct(const ColmapJob& job, const ColmapSettings& settings,
                                               const std::filesystem::path& folder);

/// Tries the model with its depths reversed (scripts/colmap.py): for a camera with a narrow view
/// and little motion, incremental mapping can converge to the wrong one of the two.
/// @return the folder of the reversed model if it fits clearly better; empty: it does not, or
///   COLMAP is the program, which does not support this
std::filesystem::path reverse_depths(const ColmapJob& job, const ColmapSettings& settings,
                                     const std::filesystem::path& model,
                                     const std::filesystem::path& folder);

}  // namespace jade::import
