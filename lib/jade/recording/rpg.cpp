// SPDX-License-Identifier: Apache-2.0
// The text layout of the event camera data sets of RPG Zurich: events.txt "t x y p" in seconds,
// images.txt "t images/NAME", calib.txt.
#include <algorithm>
#include <charconv>
#include <cmath>
#include <set>
#include <sstream>
#include <string>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/core/text.h"
#include "jade/imaging/image_io.h"
#include "jade/io/accents.h"
#include "jade/io/text.h"
#include "jade/io/zip.h"
#include "jade/recording/contents.h"
#include "jade/recording/event_folder.h"
#include "jade/recording/format.h"

namespace jade::recording {
namespace {

namespace fs = std::filesystem;

/// Names in a list or an archive must not point outside their folder.
bool stays_inside(const fs::path& name) {
  return name.is_relative() &&
         std::none_of(name.begin(), name.end(), [](const fs::path& part) { return part == ".."; });
}

/// Folder of the recording in an archive, "" or "folder/": the uppermost with a list of events.
std::string prefix_of(const io::Zip& archive) {
  std::optional<std::string> best;
  for (const std::string& name : archive.names()) {
    if (!has_ending(name, "events.txt")) continue;
    const std::string folder = name.substr(0, name.rfind('/') + 1);
    if (!best || folder.size() < best->size()) best = folder;
  }
  return best.value_or("");
}

/// The name with its ending in other letters: "a.PNG" for "a.png" and the reverse.
fs::path with_other_ending(const fs::path& name) {
  const std::string ending = name.extension().string();
  std::string other;
  for (const char letter : ending) {
    const auto c = static_cast<unsigned char>(letter);
    other += char(std::islower(c) != 0 ? std::toupper(c) : std::tolower(c));
  }
  return fs::path(name).replace_extension(other);
}

/// Lists of other tools omit the folder images/, and lists copied into that folder still contain
/// it. Accents may be in another form than the file's, and the ending in capitals.
fs::path listed_file(const fs::path& folder, const fs::path& name) {
  for (const fs::path& file : {folder / name, folder / "images" / name, folder / name.filename(),
                               folder / "images" / name.filename()}) {
    if (fs::is_regular_file(file)) return file;
    if (fs::is_regular_file(with_other_ending(file))) return with_other_ending(file);
    if (const fs::path respelled = io::respelled(file); fs::is_regular_file(respelled))
      return respelled;
  }
  return folder / name;
}

/// A name in a list. A complete path is reduced to its part in the folder, or to its last name.
fs::path name_inside(const fs::path& folder, const fs::path& name) {
  if (name.is_relative()) return name;
  for (fs::path rest = name.relative_path(); rest.has_parent_path();) {
    if (fs::is_regular_file(folder / rest)) return rest;
    rest = rest.lexically_relative(*rest.begin());
  }
  return name.filename();
}

/// The file of a list's line after the time: all of it or, if there is no such file, the part
/// before a blank that other columns may follow. Names with blanks may be quoted.
fs::path file_of_line(const fs::path& folder, std::string text) {
  constexpr const char* kBlanks = " \t\r";
  text.erase(0, std::min(text.size(), text.find_first_not_of(kBlanks)));
  if (!text.empty() && text[0] == '"') {
    const auto end = text.find('"', 1);
    return end == std::string::npos ? fs::path() : fs::path(text.substr(1, end - 1));
  }
  for (std::string name = text; !name.empty();) {
    name.erase(name.find_last_not_of(kBlanks) + 1);
    const fs::path inside = name_inside(folder, name);
    if (stays_inside(inside) && fs::is_regular_file(listed_file(folder, inside))) return inside;
    const auto blank = name.find_last_of(kBlanks);
    if (blank == std::string::npos) break;
    name.erase(blank);
  }
  return name_inside(folder, text.substr(0, text.find_first_of(kBlanks)));
}

/// UZH-FPV counts the images: "0 1540223197.055 img/image_0_0.png". The time is then the second
/// number.
/// @param number  of the image, from 0
void skip_count(size_t number, std::string& time, std::string& rest) {
  const std::string count = std::to_string(number), from_1 = std::to_string(number + 1);
  std::istringstream words(rest);
  std::string second, name;
  words >> second;
  std::getline(words >> std::ws, name);
  if (name.empty() || (time != count && time != from_1) || !number_in(io::with_point(second)))
    return;
  time = second, rest = name;
}

/// Skips images that are missing or listed twice, and warns of them. If all are missing, the image
/// reader reports the first.
void tidy_list(const fs::path& list, std::vector<FrameFile>& files,
               std::vector<std::string>& warnings) {
  std::vector<FrameFile> kept;
  std::vector<std::string> missing, twice, unlisted;
  std::set<fs::path> known, folders;
  for (const FrameFile& file : files) {
    const fs::path path = file.path.lexically_normal();
    folders.insert(path.parent_path());
    if (!fs::is_regular_file(path)) {
      missing.push_back(path.filename().string());
    } else if (!known.insert(path).second) {
      twice.push_back(path.filename().string());
    } else {
      kept.push_back(file);
    }
  }
  if (kept.empty()) return;
  for (const fs::path& folder : folders) {
    if (!fs::is_directory(folder)) continue;
    for (const fs::path& path : imaging::list_images(folder)) {
      if (known.count(path.lexically_normal()) == 0 && !is_mask_of_all(path))
        unlisted.push_back(path.filename().string());
    }
  }
  const auto warn = [&](const std::vector<std::string>& names, const char* what, const char* fix) {
    if (names.empty()) return;
    warnings.push_back(
        concat(list.string(), ": ", names.size(), what, " (", names.front(), "); ", fix));
  };
  warn(missing, " listed images are not there and are left out",
       "add the files or remove the lines");
  warn(twice, " images are listed twice, the later times are left out", "keep one line for each");
  warn(unlisted, " images of the folder are not listed and are left out",
       "add lines with their times to use them");
  files = std::move(kept);
}

/// Times are seconds unless they are whole and too far apart for that, as are µs and ns.
void set_times(const fs::path& list, const std::vector<double>& times,
               std::vector<FrameFile>& files, std::vector<std::string>& notes) {
  const torch::Tensor stored = torch::tensor(times, torch::kFloat64);
  const events::TimeUnit unit =
      events::guess_exposure_unit(stored, stored, list.string(), "give the unit");
  if (unit != events::TimeUnit::kS) {
    notes.push_back(concat(list.string(), ": expected times in seconds, found whole numbers too ",
                           "far apart; they are read as ", word_of(unit)));
  }
  const std::vector<int64_t> times_us = events::times_us(stored, unit, list.string());
  for (size_t i = 0; i < files.size(); ++i) {
    files[i].time = events::TimeWindow{times_us[i], times_us[i]};
  }
}

}  // namespace

std::vector<FrameFile> listed_images(const fs::path& list, Recording& recording) {
  std::istringstream text(io::read_text(list));
  std::vector<FrameFile> out;
  std::vector<double> times;
  std::vector<std::string> respelled;
  int64_t number = 0;
  for (std::string line; std::getline(text, line);) {
    ++number;
    // Lists from Windows have backslashes.
    std::replace(line.begin(), line.end(), '\\', '/');
    std::istringstream words(line);
    std::string time, rest;
    if (!(words >> time) || time[0] == '#') continue;
    std::getline(words, rest);
    skip_count(out.size(), time, rest);
    time = io::with_point(time);
    const fs::path name = file_of_line(list.parent_path(), rest);
    double value = 0;
    const auto [end, error] = std::from_chars(time.data(), time.data() + time.size(), value);
    if (error != std::errc() || end != time.data() + time.size() || name.empty() ||
        !std::isfinite(value) || !stays_inside(name)) {
      throw DataError(concat(list.string(), ":", number,
                             ": expected \"seconds images/NAME\" of an image; correct "
                             "this line"));
    }
    times.push_back(value);
    out.push_back({listed_file(list.parent_path(), name), std::nullopt});
    if (out.back().path.stem() != name.stem()) respelled.push_back(name.string());
  }
  set_times(list, times, out, recording.notes);
  note_respelled(list, respelled, recording.notes);
  tidy_list(list, out, recording.warnings);
  return out;
}

Contents read_zip(const fs::path& path, const ReadOptions& options) {
  const io::Zip archive(path);
  const std::string prefix = prefix_of(archive);
  const auto folder = std::make_shared<TemporaryFolder>();
  bool has_masks = false;
  for (const std::string& name : archive.names()) {
    if (name.compare(0, prefix.size(), prefix) != 0 || name.back() == '/') continue;
    const fs::path inside = name.substr(prefix.size());
    const bool mask =
        in_small_letters(*inside.begin()) == "masks" || in_small_letters(inside) == "mask.png";
    // All that may be frames, lists or a calibration; not other recordings.
    const std::string kind = in_small_letters(inside.extension().string());
    const std::string first = in_small_letters((*inside.begin()).string());
    const bool image = imaging::is_image_file(inside) || first == "images" || first == "frames";
    const bool list = kind == ".txt" || kind == ".csv" || kind == ".yaml" || kind == ".npz";
    if (!(mask || image || list) || !stays_inside(inside)) continue;
    has_masks |= mask;
    fs::create_directories((folder->path() / inside).parent_path());
    archive.extract(name, folder->path() / inside);
  }
  Contents out = read_made({folder->path(), path}, options);
  out.recording.format = word_of(Format::kZip);
  out.keep = folder;
  if (has_masks) {
    out.recording.mask_root = folder->path();
    out.recording.keep = folder;
  }
  return out;
}

}  // namespace jade::recording
