// SPDX-License-Identifier: Apache-2.0
// Files that a text names: paths of other machines, of Windows, without extensions.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace jade::data {

/// The path with the slashes of Windows turned.
std::string slashed(std::string path);

/// The path with %20 and the like replaced by what they stand for.
std::string unescaped(const std::string& path);

/// An image below `folder` whose path differs from `given` by capitals or its ending only, relative
/// to `folder`; empty where there is none.
std::filesystem::path near_image(const std::filesystem::path& folder, const std::string& given);

/// Finds a file in or below `folder` by as many of its last parts as lead to a file, all of them
/// first. Empty if none do.
std::filesystem::path file_inside(const std::filesystem::path& folder,
                                  const std::filesystem::path& given);

/// Paths as a transforms.json has them, and what became of them. They may lack an extension, have
/// the slashes of Windows, or be escaped as in a URL.
struct NamedFiles {
  std::filesystem::path folder;  ///< of the JSON, which they are relative to
  std::string image_folder;      ///< dataset.image_folder; empty: images lie where the JSON says
  std::vector<std::string> missing, moved;

  /// An image of this name, in `image_folder` where one is set. Empty where there is no such file;
  /// its name is then added to `missing`.
  std::filesystem::path find_image(const std::string& name);

  /// Empty where there is no such file; its name is then added to `missing`.
  std::filesystem::path find(const std::string& name);
};

}  // namespace jade::data
