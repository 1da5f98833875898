// SPDX-License-Identifier: Apache-2.0
// Frames of folders and videos, with the times of their lists.
#include <algorithm>
#include <charconv>
#include <cmath>
#include <sstream>
#include <string>

#include "jade/core/atomic_file.h"
#include "jade/core/child.h"
#include "jade/core/error.h"
#include "jade/core/text.h"
#include "jade/imaging/image_io.h"
#include "jade/imaging/unread_images.h"
#include "jade/io/stand_in.h"
#include "jade/io/text.h"
#include "jade/io/zip.h"
#include "jade/recording/contents.h"

namespace jade::recording {
namespace {

namespace fs = std::filesystem;

constexpr const char* kExpectedFrames = "expected a folder of images, a TIFF of pages or a video";

/// The number behind a mark and spaces in a line; no value if there is none.
template <class Number>
std::optional<Number> number_behind(const std::string& line, const std::string& mark) {
  const auto at = line.find(mark);
  if (at == std::string::npos) return std::nullopt;
  const auto begin = line.find_first_not_of(' ', at + mark.size());
  Number value{};
  if (begin == std::string::npos ||
      std::from_chars(line.data() + begin, line.data() + line.size(), value).ec != std::errc())
    return std::nullopt;
  return value;
}

/// Times reported by ffmpeg's filter showinfo, one per frame: "… pts: 512 pts_time:0.033 …". Old
/// versions round seconds to six digits, so the ticks count, in "time_base: 1/15360" of the log.
std::vector<int64_t> reported_times(const fs::path& log) {
  std::istringstream text(read_file(log));
  std::vector<int64_t> out;
  double tick_s = 0;
  for (std::string line; std::getline(text, line);) {
    if (line.find("showinfo") == std::string::npos) continue;
    const auto ticks_s = number_behind<int64_t>(line, "config in time_base:");
    const auto per_s = number_behind<int64_t>(line, "/");
    if (ticks_s && per_s && *per_s > 0) tick_s = double(*ticks_s) / double(*per_s);
    const auto seconds = number_behind<double>(line, "pts_time:");
    if (!seconds) continue;
    const auto ticks = number_behind<int64_t>(line, " pts:");
    out.push_back(std::llround(1e6 * (ticks && tick_s > 0 ? double(*ticks) * tick_s : *seconds)));
  }
  return out;
}

struct Decoding {
  int code = 0;      ///< exit code of ffmpeg
  std::string said;  ///< in brackets, the reason of a failure
};

Decoding decode(const fs::path& video, const fs::path& images, const fs::path& log) {
  Decoding out;
  // ffmpeg 9 supports only the first name of the option, 5.0 and older only the second.
  for (const char* each_once : {"-fps_mode", "-vsync"}) {
    out.code = run_to_end({"ffmpeg", "-nostdin", "-hide_banner", "-i", video.string(), "-an", "-vf",
                           "showinfo", each_once, "passthrough", (images / "%08d.png").string()},
                          {}, log);
    if (out.code == 0 || out.code == 127) return out;
    const std::string last = last_line(log);
    const bool of_the_option = last.find("Option not found") != std::string::npos;
    if (!last.empty() && (out.said.empty() || !of_the_option)) out.said = concat(" (", last, ")");
  }
  return out;
}

std::vector<FrameFile> frames_of_video(const fs::path& path, const fs::path& folder) {
  const fs::path log = folder / "ffmpeg.txt", images = folder / "video";
  fs::create_directories(images);
  const auto [code, said] = decode(path, images, log);
  if (code == 127) {
    throw DataError(concat(path.string(),
                           ": expected a folder of images, found a file; as a video "
                           "it needs the program ffmpeg: apt install ffmpeg"));
  }
  const std::vector<fs::path> files = imaging::list_images(images);
  const std::vector<int64_t> times = reported_times(log);
  if (code != 0 || files.empty()) {
    throw DataError(concat(path.string(),
                           ": expected a folder of images or a video, and ffmpeg cannot read it as "
                           "one",
                           said, "; convert it to images"));
  }
  if (times.size() < files.size()) {
    throw DataError(concat(path.string(), ": ffmpeg made ", files.size(), " images and reported ",
                           times.size(), " times; convert it to images and give their times"));
  }
  std::vector<FrameFile> out;
  for (size_t i = 0; i < files.size(); ++i)
    out.push_back({files[i], events::TimeWindow{times[i], times[i]}});
  return out;
}

/// The pages of a TIFF, with the times of a list beside it.
std::vector<FrameFile> frames_of_pages(const fs::path& path, const fs::path& folder,
                                       const ReadOptions& options, Recording& recording) {
  std::vector<FrameFile> out;
  for (const fs::path& page : imaging::split_pages(path, folder / "pages"))
    out.push_back({page, {}});
  if (options.frame_times.empty()) add_frame_list(path.parent_path(), {}, options, out, recording);
  return out;
}

/// For messages about a folder without images: those below it that have some, or its files of
/// another kind; empty if there are neither.
std::string unfound_images(const fs::path& folder) {
  std::vector<std::string> below;
  for (const fs::path& each : image_folders(folder)) below.push_back(each.string());
  if (below.empty()) return imaging::unread_images(folder);
  return concat("; found some in ", listing(below), "; give ",
                below.size() == 1 ? "that folder" : "one of these folders", " with --frames");
}

/// Warns of TIFFs with several pages, of which the first is read.
/// @throws DataError for a single TIFF, whose pages may be the frames.
void check_pages(const std::vector<FrameFile>& files, Recording& recording) {
  for (const FrameFile& file : files) {
    const size_t pages = imaging::count_pages(file.path);
    if (pages < 2) continue;
    const std::string found = concat(
        file.path.string(), ": expected one frame per file, found a TIFF of ", pages, " pages; ");
    if (files.size() == 1) {
      throw DataError(concat(found, "read its pages as frames with --frames ", file.path.string()));
    }
    recording.warnings.push_back(concat(found, "the first page of each file is read"));
    return;
  }
}

/// The images of images.txt.
/// @param may_fail  whether a list that cannot be read counts as none
std::vector<FrameFile> listed_or_none(const fs::path& list, bool may_fail, Recording& recording) {
  try {
    return listed_images(list, recording);
  } catch (const DataError&) {
    if (!may_fail) throw;
    return {};
  }
}

std::vector<FrameFile> images_of(const fs::path& images, const fs::path& root,
                                 Recording& recording) {
  std::vector<FrameFile> out;
  for (const fs::path& file : imaging::list_images(images)) {
    if (!is_mask_of_all(file)) {
      out.push_back({file, {}});
    } else if (images != root) {
      recording.warnings.push_back(concat(file.string(),
                                          ": expected the mask of all frames beside "
                                          "their folder, found it in it; move it to use it"));
    }
  }
  return out;
}

/// Whether a list is COLMAP's, whose file has this name too.
bool is_of_colmap(const fs::path& list) {
  return is_file(list.parent_path() / "cameras.txt") ||
         io::read_text(list).find("IMAGE_ID, QW") != std::string::npos;
}

/// Whether the times of a list are 0, 1, 2, … s: numbers of frames.
bool are_counted(const std::vector<FrameFile>& files) {
  constexpr int64_t kSecondUs = 1000000;
  for (size_t i = 1; i < files.size(); ++i) {
    if (files[i].time->begin_us != files[i - 1].time->begin_us + kSecondUs) return false;
  }
  return !files.empty() && files[0].time->begin_us <= kSecondUs;
}

bool is_same(const fs::path& a, const fs::path& b) {
  std::error_code ignored;
  return fs::equivalent(a, b, ignored);
}

/// Whether a list has all images of a folder, in the order of their names, each after the other.
bool lists_all(const std::vector<FrameFile>& listed, const std::vector<FrameFile>& images) {
  if (listed.size() != images.size()) return false;
  for (size_t i = 0; i < listed.size(); ++i) {
    if (!is_same(listed[i].path, images[i].path)) return false;
    if (i > 0 && listed[i].time->begin_us <= listed[i - 1].time->begin_us) return false;
  }
  return true;
}

/// Gives images the times of images.txt or FOLDER.txt (TUM's rgb.txt) above their folder, if it is
/// certain that this list is theirs.
/// @param images,root  as for add_frame_list()
void add_list_above(const fs::path& images, const fs::path& root, std::vector<FrameFile>& files,
                    Recording& recording) {
  if (images.empty() || is_same(images, root)) return;
  const std::vector<fs::path> folders = list_folders(images, root);
  for (size_t i = 1; i < folders.size(); ++i) {
    for (const std::string& name :
         {std::string("images.txt"), folders.front().filename().string() + ".txt"}) {
      const fs::path list = folders[i] / name;
      const bool is_of_events = in_small_letters(name).find("event") != std::string::npos;
      if (is_of_events || !is_file(list) || is_of_colmap(list)) continue;
      Recording with_list = recording;
      std::vector<FrameFile> listed = listed_or_none(list, true, with_list);
      if (!lists_all(listed, files) || are_counted(listed)) continue;
      files = std::move(listed), recording = std::move(with_list);
      return;
    }
  }
}

/// Times of the files by timestamps.npz; none if it cannot be read.
std::vector<FrameFile> with_npz_times(const fs::path& npz, const ReadOptions& options,
                                      std::vector<FrameFile> files) {
  Recording ignored;
  try {
    add_npz_times(npz, options.time_unit, files, ignored);
  } catch (const DataError&) {
    files.clear();
  }
  return files;
}

/// Warns of frames whose time in another list is neither in their exposure nor near it, unless that
/// list has another clock.
/// @param others  the files of `files` with their times by that list
void check_agreement(const fs::path& exposures, const fs::path& list,
                     const std::vector<FrameFile>& others, const std::vector<FrameFile>& files,
                     Recording& recording) {
  constexpr int64_t kNearUs = 1000;
  const std::optional<events::TimeWindow> first = span_of(files, 0), second = span_of(others, 0);
  if (!first || !second || others.size() != files.size() || first->end_us < second->begin_us ||
      second->end_us < first->begin_us)
    return;
  std::vector<int64_t> offsets;
  int64_t differ = 0, most_us = 0;
  for (size_t i = 0; i < files.size(); ++i) {
    if (!others[i].time || !files[i].time) return;
    const events::TimeWindow &a = *files[i].time, &b = *others[i].time;
    const int64_t apart = std::max(a.begin_us - b.end_us, b.begin_us - a.end_us);
    differ += apart > kNearUs + a.duration_us();
    most_us = std::max(most_us, apart);
    offsets.push_back(b.begin_us - a.begin_us);
  }
  const auto [least, most] = std::minmax_element(offsets.begin(), offsets.end());
  if (differ == 0 || *most - *least <= kNearUs) return;
  recording.warnings.push_back(
      concat(exposures.string(), ": gives the exposures, but ", list.filename().string(),
             " has times up to ", 1e-3 * double(most_us), " ms beside them for ", differ, " of ",
             files.size(), " frames; remove the list that is wrong"));
}

}  // namespace

bool is_mask_of_all(const fs::path& image) {
  return in_small_letters(image.filename().string()) == "mask.png";
}

bool is_file(const fs::path& path) {
  std::error_code ignored;
  return fs::is_regular_file(path, ignored);
}

bool is_folder(const fs::path& path) {
  std::error_code ignored;
  return fs::is_directory(path, ignored);
}

size_t count_images(const fs::path& folder) {
  try {
    return is_folder(folder) ? imaging::list_images(folder).size() : 0;
  } catch (const DataError&) {
    return 0;
  }
}

std::vector<fs::path> image_folders(const fs::path& folder) {
  std::error_code error;
  std::vector<fs::path> out;
  constexpr int kDeepest = 3;
  const auto options = fs::directory_options::skip_permission_denied;
  for (fs::recursive_directory_iterator entry(folder, options, error), end; !error && entry != end;
       entry.increment(error)) {
    std::error_code ignored;
    const std::string name = in_small_letters(entry->path().filename().string());
    const bool is_passed = name[0] == '.' || name == "masks";
    if (is_passed || entry.depth() >= kDeepest) entry.disable_recursion_pending();
    if (!is_passed && entry->is_directory(ignored) && count_images(entry->path()) > 0)
      out.push_back(entry->path());
  }
  std::sort(out.begin(), out.end());
  return out;
}

std::vector<FrameFile> timed_images(const fs::path& images, const fs::path& root,
                                    const ReadOptions& options, Recording& recording) {
  std::vector<fs::path> folders{images, root};
  if (!images.empty() && !root.empty()) {
    const std::vector<fs::path> between = list_folders(images, root);
    folders.insert(folders.end(), between.begin(), between.end());
  }
  const auto found = [&](const char* name) {
    for (const fs::path& folder : folders) {
      if (!folder.empty() && is_file(folder / name)) return folder / name;
    }
    return fs::path();
  };
  // Times that the user gives replace all of the folder.
  const bool given = !options.frame_times.empty();
  const fs::path exposures = given ? fs::path() : found("exposures.csv");
  const fs::path npz = given ? fs::path() : found("timestamps.npz");
  const fs::path lines = npz.empty() || !exposures.empty() ? found("images.txt") : fs::path();
  std::vector<FrameFile> out;
  if (!lines.empty() && !is_of_colmap(lines))
    out = listed_or_none(lines, given || !exposures.empty(), recording);
  const bool listed = !out.empty();
  if (!listed && !images.empty()) out = images_of(images, root, recording);
  if (out.empty()) return out;
  check_pages(out, recording);
  if (!exposures.empty()) {
    const std::vector<FrameFile> others =
        listed || npz.empty() ? out : with_npz_times(npz, options, out);
    apply_exposures(exposures, read_exposures(exposures), out, recording);
    check_agreement(exposures, listed ? lines : npz, others, out, recording);
  } else if (!npz.empty()) {
    add_npz_times(npz, options.time_unit, out, recording);
  } else if (!listed && !given && !add_frame_list(images, root, options, out, recording)) {
    add_list_above(images, root, out, recording);
  }
  return out;
}

void warn_of_no_images(const fs::path& folder, Recording& recording) {
  fs::path at = folder;
  std::string found = unfound_images(folder);
  for (const char* name : {"images", "images_1", "frames"}) {
    if (!found.empty() || !is_folder(folder / name)) continue;
    at = folder / name, found = imaging::unread_images(at);
  }
  if (found.empty() && at == folder) return;
  recording.warnings.push_back(concat(at.string(), ": expected images, found none", found));
}

void replace_frames(const fs::path& path, const ReadOptions& options, Contents& contents) {
  std::error_code ignored;
  if (!fs::exists(path, ignored))
    throw DataError(concat(path.string(), ": no such folder of images or video"));
  Recording& recording = contents.recording;
  if (fs::is_directory(path, ignored)) {
    contents.files = timed_images(path, {}, options, recording);
    if (!contents.files.empty()) return;
    throw DataError(concat(path.string(), ": expected images, found none", unfound_images(path)));
  }
  if (const std::string other = io::stand_in(path); !other.empty())
    throw DataError(concat(path.string(), ": ", kExpectedFrames, ", found ", other));
  if (io::is_zip(path)) {
    throw DataError(concat(path.string(), ": ", kExpectedFrames,
                           ", found a zip archive; unpack it and give the folder of the images"));
  }
  if (!contents.keep) contents.keep = std::make_shared<TemporaryFolder>();
  // A folder of their own, as `keep` may have files of the recording.
  const fs::path frames = contents.keep->path() / "--frames";
  fs::create_directories(frames);
  contents.made.insert(contents.made.begin(), {frames, path});
  const std::string kind = in_small_letters(path.extension().string());
  if (kind == ".tif" || kind == ".tiff") {
    contents.files = frames_of_pages(path, frames, options, recording);
    return;
  }
  contents.files = frames_of_video(path, frames);
  recording.stamp = Stamp::kStart;
  recording.notes.push_back(concat(path.string(), ": its frames have the clock of the video"));
}

}  // namespace jade::recording
