// SPDX-License-Identifier: Apache-2.0
#include "jade/config/document.h"

#include <yaml-cpp/yaml.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"

namespace jade::config {
namespace {

DocumentNode copy_of(const YAML::Node& node) {
  DocumentNode copy;
  copy.line = node.Mark().line + 1;
  copy.column = node.Mark().column + 1;
  if (node.IsScalar()) {
    copy.kind = DocumentNode::Kind::kText;
    copy.text = node.Scalar();
  } else if (node.IsSequence()) {
    copy.kind = DocumentNode::Kind::kList;
    for (const auto& item : node) copy.items.push_back(copy_of(item));
  } else if (node.IsMap()) {
    copy.kind = DocumentNode::Kind::kMap;
    for (const auto& entry : node) {
      copy.entries.emplace_back(entry.first.IsScalar() ? entry.first.Scalar() : "?",
                                copy_of(entry.second));
    }
  }
  return copy;
}

}  // namespace

const DocumentNode* DocumentNode::find(const std::string& name) const {
  for (const auto& [key, node] : entries) {
    if (key == name) return &node;
  }
  return nullptr;
}

DocumentNode read_document(const std::filesystem::path& file) {
  if (!std::filesystem::is_regular_file(file)) {
    throw ConfigError(concat(file.string(), ": expected a YAML file, found none"));
  }
  try {
    return copy_of(YAML::Load(read_file(file)));
  } catch (const YAML::Exception& failure) {
    throw ConfigError(concat(file.string(), ":", failure.mark.line + 1, ":",
                             failure.mark.column + 1, ": not valid YAML: ", failure.msg));
  }
}

}  // namespace jade::config
