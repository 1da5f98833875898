// SPDX-License-Identifier: Apache-2.0
#include "jade/data/named_files.h"

#include <algorithm>

namespace jade::data {
namespace {

namespace fs = std::filesystem;

/// A file whose name may lack an extension; empty where there is none.
fs::path existing_file(const fs::path& path) {
  for (const char* extension : {"", ".png", ".jpg", ".jpeg", ".JPG", ".PNG", ".JPEG"}) {
    const fs::path whole = path.string() + extension;
    if (fs::is_regular_file(whole)) return whole.lexically_normal();
  }
  return {};
}

/// Finds a file whose path was written on another machine or from another folder, by as many of its
/// last parts as lead to a file. Empty if none do.
fs::path moved_file(const fs::path& folder, const fs::path& given) {
  const std::vector<fs::path> parts(given.begin(), given.end());
  for (size_t skip = 1; skip < parts.size(); ++skip) {
    fs::path tail;
    for (size_t i = skip; i < parts.size(); ++i) tail /= parts[i];
    if (tail.is_absolute() || tail.empty()) continue;
    if (fs::path found = existing_file(folder / tail); !found.empty()) return found;
  }
  return {};
}

}  // namespace

std::string slashed(std::string path) {
  std::replace(path.begin(), path.end(), '\\', '/');
  return path;
}

fs::path file_inside(const fs::path& folder, const fs::path& given) {
  std::vector<fs::path> parts;
  for (const fs::path& part : given.relative_path()) {
    if (part != "." && part != "..") parts.push_back(part);
  }
  for (size_t skip = 0; skip < parts.size(); ++skip) {
    fs::path tail;
    for (size_t i = skip; i < parts.size(); ++i) tail /= parts[i];
    if (tail.empty()) continue;
    if (fs::path found = existing_file(folder / tail); !found.empty()) return found;
  }
  return {};
}

fs::path NamedFiles::find_image(const std::string& name) {
  if (image_folder.empty()) return find(name);
  fs::path found = file_inside(folder / image_folder, slashed(name));
  if (found.empty()) missing.push_back(name);
  return found;
}

fs::path NamedFiles::find(const std::string& name) {
  // On Linux a backslash may be part of a name.
  if (fs::path found = existing_file(folder / name); !found.empty()) return found;
  const fs::path given = slashed(name);
  if (fs::path found = existing_file(folder / given); !found.empty()) return found;
  if (fs::path found = moved_file(folder, given); !found.empty()) {
    moved.push_back(name);
    return found;
  }
  missing.push_back(name);
  return {};
}

}  // namespace jade::data
