// SPDX-License-Identifier: Apache-2.0
// A YAML file as a plain tree, for files that an options struct cannot describe: lists of entries.
#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace jade::config {

struct DocumentNode {
  enum class Kind { kNothing, kText, kList, kMap };
  Kind kind = Kind::kNothing;
  std::string text;                                           ///< kText, as written
  std::vector<DocumentNode> items;                            ///< kList
  std::vector<std::pair<std::string, DocumentNode>> entries;  ///< kMap, in the file's order
  int line = 0, column = 0;                                   ///< counted from 1

  /// The entry of that name, or nullptr.
  const DocumentNode* find(const std::string& name) const;
};

/// @throws ConfigError if the file cannot be read or is not YAML.
DocumentNode read_document(const std::filesystem::path& file);

}  // namespace jade::config
