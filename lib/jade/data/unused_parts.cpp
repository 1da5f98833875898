// SPDX-License-Identifier: Apache-2.0
#include "jade/data/unused_parts.h"

#include <algorithm>

#include "jade/core/text.h"
#include "jade/data/named_files.h"

namespace jade::data {
namespace {

namespace fs = std::filesystem;

/// Compares without case, because tools on Windows and macOS write Masks or IMU.csv.
/// @param pattern  with at most one '*', which matches any characters
bool fits(const std::string& given, const std::string& wanted) {
  const std::string name = in_small_letters(given), pattern = in_small_letters(wanted);
  const size_t star = pattern.find('*');
  if (star == std::string::npos) return name == pattern;
  const std::string front = pattern.substr(0, star), back = pattern.substr(star + 1);
  return name.size() >= front.size() + back.size() && name.rfind(front, 0) == 0 &&
         name.compare(name.size() - back.size(), back.size(), back) == 0;
}

/// The first name in order that fits; empty if none does.
std::string first_that_fits(const fs::path& folder, const std::string& pattern, bool is_folder) {
  std::string first;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    std::error_code ignored;
    const bool right_kind =
        is_folder ? entry->is_directory(ignored) && !fs::is_empty(entry->path(), ignored)
                  : entry->is_regular_file(ignored);
    if (right_kind && fits(name, pattern) && (first.empty() || name < first)) first = name;
  }
  return first;
}

}  // namespace

void UnusedParts::add(const std::string& name, const std::string& meaning) {
  const std::string text = name + " (" + meaning + ")";
  if (std::find(found_.begin(), found_.end(), text) == found_.end()) found_.push_back(text);
}

void UnusedParts::look_for_files(const fs::path& folder, const std::vector<FormatPart>& parts) {
  for (const FormatPart& part : parts) {
    const bool is_folder = part.name.back() == '/';
    const fs::path pattern = is_folder ? part.name.substr(0, part.name.size() - 1) : part.name;
    const std::string name =
        first_that_fits(folder / pattern.parent_path(), pattern.filename().string(), is_folder);
    if (name.empty()) continue;
    add((pattern.parent_path() / name).string() + (is_folder ? "/" : ""), part.meaning);
  }
}

void UnusedParts::look_for_keys(const std::set<std::string>& keys,
                                const std::vector<FormatPart>& parts) {
  for (const FormatPart& part : parts) {
    if (keys.count(part.name) != 0) add("'" + part.name + "'", part.meaning);
  }
}

void UnusedParts::warn(const fs::path& path, const std::string& layout,
                       const Warnings& warnings) const {
  if (found_.empty()) return;
  warnings.add(path.string(), ": has ", listing(found_, found_.size()),
               ", which the reader of the layout ", layout, " does not use");
}

UnusedParts unused_in_any_layout(const fs::path& root, const fs::path& frames, bool names_masks,
                                 const std::vector<fs::path>& read) {
  static const std::vector<FormatPart> in_root = {
      {"depths/", "depth maps"},
      {"depth/", "depth maps"},
      {"normals/", "maps of normals"},
      {"normal/", "maps of normals"},
      {"semantics/", "semantic labels"},
      {"segmentations/", "semantic labels"},
      {"dynamic_masks/", "masks of moving objects; those that count are read from masks/"},
      {"motion_masks/", "masks of moving objects; those that count are read from masks/"},
      {"mask.jpg", "a mask; those of all frames are named mask.png"},
      {"rectify_map.h5", "DSEC's map from raw events to the image; events are taken as they are"},
      {"exposures.npy", "exposure of each frame"},
      {"exposures.txt", "exposure of each frame"},
      {"imu.*", "inertial measurements"},
  };
  static const std::vector<FormatPart> beside_frames = {
      {"*.exr", "HDR frames"},
      {"*.hdr", "HDR frames"},
      {"*.dng", "raw frames"},
      {"*.nef", "raw frames"},
      {"*.cr2", "raw frames"},
      {"*.arw", "raw frames"},
      {"*.gif", "frames of a format that is not read"},
      {"*.heic", "frames of a format that is not read"},
      {"*.heif", "frames of a format that is not read"},
      {"*.jxl", "frames of a format that is not read"},
      {"*.avif", "frames of a format that is not read"},
      {"*.jp2", "frames of a format that is not read"},
      {"dynamic_mask_*", "masks of instant-ngp; those that count are read from masks/"},
  };
  UnusedParts parts;
  parts.look_for_files(root, in_root);
  for (const FormatPart& part : beside_frames) {
    const bool in_use = std::any_of(read.begin(), read.end(), [&](const fs::path& frame) {
      return part.name == concat("*", in_small_letters(frame.extension().string()));
    });
    if (!in_use) parts.look_for_files(frames, {part});
  }
  if (names_masks) return parts;
  const std::string meaning = "masks; those that count are read from masks/ beside the frames";
  parts.look_for_files(root, {{"mask/", meaning}});
  const std::string name = frames.filename().string();
  if (!name.empty() && fs::absolute(frames).lexically_normal() !=
                           fs::absolute(root / ".").lexically_normal().parent_path()) {
    parts.look_for_files(
        frames.parent_path(),
        {{"mask/", meaning}, {name + "/masks/", meaning}, {name + "/mask/", meaning}});
  }
  return parts;
}

}  // namespace jade::data
