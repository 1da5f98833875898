// SPDX-License-Identifier: Apache-2.0
// COLMAP as a process: the program, or the package pycolmap through scripts/colmap.py.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "jade/geometry/camera.h"

namespace jade::import {

/// The words before COLMAP's own: the program `wanted`, else the package pycolmap through
/// scripts/colmap.py, which on a processor takes a quarter of the time of the program that Debian
/// 12 has, else colmap of the path.
/// @throws DataError with the command that installs it.
std::vector<std::string> find_colmap(const std::filesystem::path& wanted);

/// Settings that all attempts at one set of images share.
struct ColmapJob {
  std::vector<std::string> program;  ///< find_colmap()
  std::filesystem::path images;      ///< folder
  int64_t count = 0;                 ///< of the images in it
  /// Camera of all images, at their size, held fixed; absent: the focal length is searched, and the
  /// principal point is the middle.
  std::optional<geometry::Intrinsics> camera;
  /// Image of the same size, black where no features are to be found; empty: none.
  std::filesystem::path mask;
  /// Folder with such an image for each, IMAGE.png.png for IMAGE.png; empty: none.
  std::filesystem::path own_masks;
  /// Names of the images that are compared; empty: all with all.
  std::vector<std::pair<std::string, std::string>> pairs;
};

/// Flags beside ours, as COLMAP spelled them up to 3.12.
struct ColmapSettings {
  std::string name;  ///< of the attempt and its folder
  std::vector<std::string> extraction, matching, mapping;
};

/// Finds and compares features. Writes FOLDER/database.db and FOLDER/colmap.log. Shows progress.
/// @throws DataError with COLMAP's last words where it fails, Interrupted.
void match_features(const ColmapJob& job, const ColmapSettings& settings,
                    const std::filesystem::path& folder);

/// Reconstructs from FOLDER/database.db into FOLDER/NAME.
/// @return the folders of the models that came out, none where no pair of images began one
std::vector<std::filesystem::path> reconstruct(const ColmapJob& job, const ColmapSettings& settings,
                                               const std::filesystem::path& folder);

/// Tries the model with its depths reversed (scripts/colmap.py): of a camera with a narrow view
/// that moves little, incremental mapping ends in the wrong one of the two by chance.
/// @return the folder of the reversed model where it fits clearly better; empty: it does not, or
///   COLMAP is the program, which cannot try
std::filesystem::path reverse_depths(const ColmapJob& job, const std::filesystem::path& model,
                                     const std::filesystem::path& folder);

}  // namespace jade::import
