// SPDX-License-Identifier: Apache-2.0
// Standard parts of a data set's format that a reader knows and does not use.
#pragma once

#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "jade/data/warnings.h"

namespace jade::data {

/// A key, a file or a folder that changes what other programs make of a data set.
struct FormatPart {
  /// Name of a key; path of a file in a folder, with at most one '*' in the last part; path of a
  /// folder with '/' at the end.
  std::string name;
  std::string meaning;  ///< what it holds, in a few words
};

/// Collects what a reader found and does not use, so that one warning names all of it.
class UnusedParts {
 public:
  /// Notes the parts whose files or folders lie in `folder`; empty folders do not count.
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

/// Parts that no reader uses: depth maps, normals and the like in the folder of a data set, and
/// frames of other formats beside those that are read, and masks in mask/ or among the frames.
/// @param names_masks  the data set names the files of its masks, so those folders may be in use
/// @param read         frames that were read; formats among them are no formats that are not read
UnusedParts unused_in_any_layout(const std::filesystem::path& root,
                                 const std::filesystem::path& frames, bool names_masks = false,
                                 const std::vector<std::filesystem::path>& read = {});

}  // namespace jade::data
