// SPDX-License-Identifier: Apache-2.0
// Stereo recordings, of which the left camera is read.
#include <string>

#include "jade/core/error.h"
#include "jade/core/text.h"
#include "jade/recording/contents.h"

namespace jade::recording {
namespace {

namespace fs = std::filesystem;

/// The path with "right" for "left" in its part below a folder; empty if there is none.
fs::path of_right_camera(const fs::path& path, const fs::path& folder) {
  std::string name = path.lexically_relative(folder).string();
  const std::string before = name;
  for (const auto& [left, right] : {std::pair("left", "right"), std::pair("Left", "Right")}) {
    for (size_t at = 0; (at = name.find(left, at)) != std::string::npos; at += 5)
      name.replace(at, 4, right);
  }
  const fs::path other = folder / name;
  const bool is_there = is_file(other) || count_images(other) > 0;
  return name != before && is_there ? other : fs::path();
}

}  // namespace

void note_right_camera(const fs::path& folder, const std::vector<fs::path>& read,
                       Recording& recording) {
  std::vector<std::string> used, others;
  for (const fs::path& path : read) {
    if (path.empty() || of_right_camera(path, folder).empty()) continue;
    used.push_back(path.lexically_relative(folder).string());
    others.push_back(of_right_camera(path, folder).lexically_relative(folder).string());
  }
  if (used.empty()) return;
  recording.notes.push_back(concat(folder.string(), ": of two cameras the left is read (",
                                   listing(used), "), not the right (", listing(others),
                                   "); choose by giving the file of the events, and --frames"));
}

}  // namespace jade::recording
