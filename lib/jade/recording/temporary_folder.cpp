// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstdlib>
#include <string>

#include "jade/core/error.h"
#include "jade/recording/contents.h"

namespace jade::recording {

TemporaryFolder::TemporaryFolder() {
  std::error_code error;
  const auto parent = std::filesystem::temp_directory_path(error);
  std::string pattern = (parent / "jade-recording-XXXXXX").string();
  if (error || mkdtemp(pattern.data()) == nullptr) {
    throw DataError(concat(pattern,
                           ": no temporary folder can be made; set TMPDIR to a folder "
                           "with space"));
  }
  path_ = pattern;
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

std::string renamed(const std::vector<Made>& made, std::string line) {
  for (const Made& each : made) {
    const std::string folder = each.folder.string() + "/", original = each.original.string();
    if (!each.keeps_names && line.rfind(folder, 0) == 0)
      line = original + line.substr(std::min(line.find(": "), line.size()));
    for (size_t at = 0; each.keeps_names && (at = line.find(folder, at)) != std::string::npos;) {
      line.replace(at, folder.size(), original + "/");
      at += original.size();
    }
    // The folder itself, before a colon.
    const std::string whole = each.folder.string() + ":";
    if (line.rfind(whole, 0) == 0) line = original + line.substr(whole.size() - 1);
  }
  return line;
}

Contents read_made(const Made& made, const ReadOptions& options) {
  try {
    Contents out = read_event_folder(made.folder, options);
    out.made = {made};
    return out;
  } catch (const DataError& error) {
    throw DataError(renamed({made}, error.what()));
  }
}

}  // namespace jade::recording
