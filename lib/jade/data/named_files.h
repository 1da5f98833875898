// SPDX-License-Identifier: Apache-2.0
// Resolves file names in text: paths of other machines, of Windows, without extensions.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "jade/data/warnings.h"

namespace jade::data {

/// The path with backslashes replaced by slashes.
std::string slashed(std::string path);

/// Warns of names in `list` whose accents are stored in another form than those of the files.
void tell_respelled(const std::filesystem::path& list, const std::vector<std::string>& names,
                    const Warnings& warnings);

/// The place of `name` in a list: the same name, else the only one that equals it up to composed
/// and decomposed accents. No value if there is none.
std::optional<size_t> place_of(const std::string& name, const std::vector<std::string>& names);

/// The entry `name` of a folder, or the first in order that differs only by case; `folder / name`
/// if there is none. Empty folders do not count.
std::filesystem::path in_any_case(const std::filesystem::path& folder, const std::string& name);

/// An image below `folder` whose path differs from `given` only by case or extension, relative to
/// `folder`; empty if there is none.
std::filesystem::path near_image(const std::filesystem::path& folder, const std::string& given);

/// Finds a file in or below `folder` by the longest suffix of its path that leads to a file. Empty
/// if none does.
std::filesystem::path file_inside(const std::filesystem::path& folder,
                                  const std::filesystem::path& given);

/// Resolves the paths of a transforms.json. They may lack an extension, have backslashes, or be
/// escaped as in a URL, and may have their accents in another form than the files (macOS).
struct NamedFiles {
  std::filesystem::path folder;  ///< folder of the JSON, to which paths are relative
  std::string image_folder;      ///< dataset.image_folder; empty: images are where the JSON says
  std::vector<std::string> missing, moved;
  std::vector<std::string> respelled;  ///< images whose files have their accents in another form

  /// An image of this name, in `image_folder` if one is set. If there is no such file, returns an
  /// empty path and adds the name to `missing`.
  std::filesystem::path find_image(const std::string& name);

  /// Returns an empty path and adds the name to `missing` if there is no such file.
  std::filesystem::path find(const std::string& name);
};

}  // namespace jade::data
