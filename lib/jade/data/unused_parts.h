// SPDX-License-Identifier: Apache-2.0
// Standard parts of a data set's format that a reader recognises but does not use.
#pragma once

#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "jade/data/warnings.h"

namespace jade::data {

/// A key, a file or a folder that other programs use.
struct FormatPart {
  /// Name of a key; path of a file in a folder, with at most one '*' in the last part; path of a
  /// folder with '/' at the end.
  std::string name;
  std::string meaning;  ///< its content, in a few words
};

/// Collects the parts that a reader found and does not use, so that one warning names all of them.
class UnusedParts {
 public:
  /// Notes the parts whose files or folders are in `folder`; ignores empty folders.
  void look_for_files(const std::filesystem::path& folder, const std::vector<FormatPart>& parts);
  /// Notes the parts that are among the keys.
  void look_for_keys(const std::set<std::string>& keys, const std::vector<FormatPart>& parts);
  /// "PATH: has depths/ (depth maps), which the reader of LAYOUT does not use", or nothing.
  void warn(const std::filesystem::path& path, const std::string& layout,
            const Warnings& warnings) const;

 private:
  void add(const std::string& name, const std::string& meaning);

  std::vector<std::string> found_;
};

/// Parts that no reader uses: depth maps, normals and the like in the folder of a data set, frames
/// of unsupported formats, and masks in mask/ or among the frames.
/// @param names_masks  whether the data set names its mask files, so that those folders may be in
///   use
/// @param read         frames that were read; their formats are not reported as unsupported
UnusedParts unused_in_any_layout(const std::filesystem::path& root,
                                 const std::filesystem::path& frames, bool names_masks = false,
                                 const std::vector<std::filesystem::path>& read = {});

}  // namespace jade::data
