// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <torch/serialize/archive.h>
#include <torch/types.h>

namespace jade::test {

/// All entries of a checkpoint, by name.
inline std::map<std::string, torch::Tensor> checkpoint_entries(const std::filesystem::path& path) {
  torch::serialize::InputArchive archive;
  archive.load_from(path.string(), torch::kCPU);
  std::map<std::string, torch::Tensor> entries;
  for (const std::string& name : archive.keys()) {
    c10::IValue value;
    archive.read(name, value);
    if (value.isTensor()) entries[name] = value.toTensor();
  }
  return entries;
}

/// Names of the entries that are not bit-equal in two checkpoints.
inline std::set<std::string> differing_entries(const std::filesystem::path& a,
                                               const std::filesystem::path& b) {
  const auto of_a = checkpoint_entries(a), of_b = checkpoint_entries(b);
  std::set<std::string> names;
  for (const auto& [name, tensor] : of_a) {
    const auto found = of_b.find(name);
    if (found == of_b.end() || !found->second.equal(tensor)) names.insert(name);
  }
  for (const auto& [name, tensor] : of_b) {
    if (of_a.count(name) == 0) names.insert(name);
  }
  return names;
}

/// Whether any name begins with `prefix`.
inline bool any_begins_with(const std::set<std::string>& names, const std::string& prefix) {
  const auto first = names.lower_bound(prefix);
  return first != names.end() && first->rfind(prefix, 0) == 0;
}

}  // namespace jade::test
