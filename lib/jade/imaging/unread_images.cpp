// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/unread_images.h"

#include <algorithm>
#include <map>
#include <set>

#include "jade/core/error.h"
#include "jade/core/text.h"

namespace jade::imaging {

namespace fs = std::filesystem;

std::string unread_images(const fs::path& folder) {
  static const std::set<std::string> others{".txt", ".csv", ".tsv", ".json", ".yaml", ".yml",
                                            ".xml", ".npz", ".npy", ".md",   ".h5",   ".hdf5",
                                            ".raw", ".bin", ".ply", ".log",  ""};
  static const std::set<std::string> videos{".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v"};
  std::map<std::string, int64_t> counts;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    std::error_code ignored;
    const std::string kind = in_small_letters(entry->path().extension().string());
    const std::string name = entry->path().filename().string();
    const bool hidden = name[0] == '.' || name == "Thumbs.db" || name == "desktop.ini";
    if (!hidden && others.count(kind) == 0 && entry->is_regular_file(ignored)) ++counts[kind];
  }
  const auto most =
      std::max_element(counts.begin(), counts.end(),
                       [](const auto& a, const auto& b) { return a.second < b.second; });
  if (most == counts.end()) return "";
  return concat("; found ", most->second, most->second == 1 ? " file " : " files ", most->first,
                " in ", folder.string(), most->second == 1 ? ", which is" : ", which are",
                " not read as frames; ",
                videos.count(most->first) > 0
                    ? "extract its frames as images"
                    : "convert them to .png, .jpg, .tif, .bmp, .webp, .ppm or .pgm");
}

}  // namespace jade::imaging
