// SPDX-License-Identifier: Apache-2.0
#include "jade/data/named_files.h"

#include <algorithm>

#include "jade/core/text.h"
#include "jade/imaging/image_io.h"
#include "jade/io/accents.h"
#include "jade/io/uri.h"

namespace jade::data {
namespace {

namespace fs = std::filesystem;

/// A file whose name may lack an extension; empty if there is none.
fs::path existing_file(const fs::path& path) {
  for (const char* extension : {"", ".png", ".jpg", ".jpeg", ".JPG", ".PNG", ".JPEG"}) {
    const fs::path whole = path.string() + extension;
    if (fs::is_regular_file(whole)) return whole.lexically_normal();
    const fs::path respelled = io::respelled(whole);
    if (fs::is_regular_file(respelled)) return respelled.lexically_normal();
  }
  return {};
}

/// Finds a file whose path was written on another machine or relative to another folder, by the
/// longest suffix of its path that leads to a file. Empty if none does.
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

/// The subfolder of this name, matching case if possible; empty if there is none.
fs::path near_folder(const fs::path& folder, const fs::path& name) {
  std::error_code error;
  if (fs::is_directory(folder / name, error)) return (folder / name).lexically_normal();
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    std::error_code ignored;
    if (entry->is_directory(ignored) &&
        in_small_letters(entry->path().filename().string()) == in_small_letters(name.string())) {
      return entry->path();
    }
  }
  return {};
}

}  // namespace

std::optional<size_t> place_of(const std::string& name, const std::vector<std::string>& names) {
  const auto exact = std::find(names.begin(), names.end(), name);
  if (exact != names.end()) return size_t(exact - names.begin());
  std::optional<size_t> place;
  for (size_t i = 0; i < names.size(); ++i) {
    if (!io::same_but_accents(name, names[i])) continue;
    if (place) return std::nullopt;
    place = i;
  }
  return place;
}

fs::path in_any_case(const fs::path& folder, const std::string& name) {
  std::error_code error;
  const auto is_empty_folder = [](const fs::path& path) {
    std::error_code ignored;
    return fs::is_directory(path, ignored) && fs::is_empty(path, ignored);
  };
  const fs::path exact = folder / name;
  if (fs::exists(exact, error) && !is_empty_folder(exact)) return exact;
  std::string first;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    const std::string found = entry->path().filename().string();
    if (in_small_letters(found) == in_small_letters(name) && !is_empty_folder(entry->path()) &&
        (first.empty() || found < first))
      first = found;
  }
  return first.empty() ? exact : folder / first;
}

std::string slashed(std::string path) {
  std::replace(path.begin(), path.end(), '\\', '/');
  return path;
}

void tell_respelled(const fs::path& list, const std::vector<std::string>& names,
                    const Warnings& warnings) {
  if (names.empty()) return;
  warnings.add(list.string(), ": ", names.size(), " names, such as ", names.front(),
               ", have accents in another form than the files (one letter, or a letter and a mark, "
               "as macOS writes them); the files that look alike are used");
}

fs::path near_image(const fs::path& folder, const std::string& given) {
  const fs::path path = fs::path(slashed(given)).lexically_normal().relative_path();
  fs::path place = folder;
  for (const fs::path& part : path.parent_path()) {
    place = near_folder(place, part);
    if (place.empty()) return {};
  }
  if (!fs::is_directory(place)) return {};
  const std::string name = in_small_letters(path.filename().string()),
                    stem = in_small_letters(path.stem().string());
  for (const fs::path& image : imaging::list_images(place)) {
    const std::string found = in_small_letters(image.stem().string());
    if (found == stem || found == name) return image.lexically_relative(folder);
  }
  return {};
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
  fs::path found;
  if (image_folder.empty()) {
    found = find(name);
  } else {
    found = file_inside(folder / image_folder, slashed(name));
    if (found.empty()) found = file_inside(folder / image_folder, slashed(io::unescaped(name)));
    if (found.empty()) missing.push_back(name);
  }
  const std::string stem = found.stem().string();
  if (name.find(stem) == name.npos && io::unescaped(name).find(stem) == name.npos)
    respelled.push_back(name);
  return found;
}

fs::path NamedFiles::find(const std::string& name) {
  // On Linux a backslash may be part of a name.
  if (fs::path found = existing_file(folder / name); !found.empty()) return found;
  const fs::path given = slashed(name);
  if (fs::path found = existing_file(folder / given); !found.empty()) return found;
  const fs::path plain = slashed(io::unescaped(name));
  if (fs::path found = existing_file(folder / plain); !found.empty()) return found;
  for (const fs::path& whole : {given, plain}) {
    if (fs::path found = moved_file(folder, whole); !found.empty()) {
      moved.push_back(name);
      return found;
    }
  }
  missing.push_back(name);
  return {};
}

}  // namespace jade::data
