// SPDX-License-Identifier: Apache-2.0
#include "jade/import/fingerprint.h"

#include <algorithm>
#include <chrono>
#include <vector>

#include "jade/core/error.h"

namespace jade::import {
namespace {

namespace fs = std::filesystem;

/// Calls `visit` with each file below a folder, following links to other folders.
/// @param above  the ancestors of the folder and the folder itself; links to them are skipped
template <class Visit>
void for_files(const fs::path& folder, std::vector<fs::path> above, const Visit& visit) {
  std::error_code unreadable;
  above.push_back(fs::canonical(folder, unreadable));
  for (fs::directory_iterator entry(folder, unreadable), end; !unreadable && entry != end;
       entry.increment(unreadable)) {
    std::error_code ignored;
    if (entry->is_regular_file(ignored)) visit(entry->path());
    if (!entry->is_directory(ignored)) continue;
    const fs::path place = fs::canonical(entry->path(), ignored);
    if (std::find(above.begin(), above.end(), place) == above.end()) {
      for_files(entry->path(), above, visit);
    }
  }
}

}  // namespace

std::string fingerprint(const fs::path& path) {
  // Ignore unreadable files here; the reader reports them.
  std::error_code unreadable;
  const auto line = [&](const fs::path& file) {
    const auto changed = fs::last_write_time(file, unreadable).time_since_epoch();
    return concat(file.string(), ' ', fs::file_size(file, unreadable), ' ',
                  std::chrono::duration_cast<std::chrono::microseconds>(changed).count(), '\n');
  };
  if (fs::is_regular_file(path, unreadable)) return line(path);
  if (!fs::is_directory(path, unreadable)) return {};
  std::vector<std::string> lines;
  for_files(path, {}, [&](const fs::path& file) { lines.push_back(line(file)); });
  std::sort(lines.begin(), lines.end());
  std::string all;
  for (const std::string& each : lines) all += each;
  return all;
}

}  // namespace jade::import
