// SPDX-License-Identifier: Apache-2.0
#include "jade/recording/format.h"

#include <algorithm>
#include <fstream>
#include <string>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/text.h"
#include "jade/io/colmap.h"
#include "jade/io/gzip.h"
#include "jade/io/stand_in.h"
#include "jade/io/zip.h"
#include "jade/recording/contents.h"
#include "jade/recording/event_folder.h"

namespace jade::recording {
namespace {

namespace fs = std::filesystem;

constexpr const char* kReadable =
    "expected a recording (Prophesee .raw or .dat, folder of frames and events or its .zip, HDF5, "
    ".npz, .npy, "
    "text, .aedat, .aedat4, ROS bag)";

bool begins(const std::string& head, const std::string& with) {
  return head.compare(0, with.size(), with) == 0;
}

std::string head_of(const fs::path& path) {
  std::error_code ignored;
  if (fs::exists(path, ignored) && !fs::is_regular_file(path, ignored)) {  // a pipe would hang
    throw DataError(concat(path.string(), ": ", kReadable, ", found a pipe or a device"));
  }
  std::ifstream file(path, std::ios::binary);
  std::string head(4096, '\0');
  file.read(head.data(), std::streamsize(head.size()));
  head.resize(size_t(std::max<std::streamsize>(file.gcount(), 0)));
  if (head.empty()) {
    if (const std::string other = file.is_open() ? "" : io::stand_in(path); !other.empty())
      throw DataError(concat(path.string(), ": ", kReadable, ", found ", other));
    std::error_code error;
    const auto size = fs::file_size(path, error);
    throw DataError(concat(path.string(), !error && size == 0
                                              ? ": the file is empty; copy or record it again"
                                              : ": the file cannot be read"));
  }
  return head;
}

/// Whether all characters are printable.
bool is_text(const std::string& head) {
  return std::all_of(head.begin(), head.end(), [](unsigned char c) {
    return c == '\n' || c == '\r' || c == '\t' || (c >= 32 && c < 127);
  });
}

Format zip_format(const fs::path& path) {
  const io::Zip archive(path);
  const auto ends = [&](const char* tail) {
    return std::any_of(archive.names().begin(), archive.names().end(),
                       [&](const auto& name) { return has_ending(name, tail); });
  };
  if (ends("events.txt")) return Format::kZip;
  if (ends(".npy")) return Format::kNpz;
  throw DataError(concat(path.string(),
                         ": expected an archive with events.txt or .npy arrays in it, "
                         "found neither; unpack it and give the recording inside"));
}

/// DAT files of Metavision name the format in their first lines; others are recognised by the type
/// and the size of an event after these.
bool is_dat(const std::string& head) {
  if (begins(head, "% Data file containing") || begins(head, "% DAT")) return true;
  if (!begins(head, "%") || head.find("evt ") != std::string::npos ||
      head.find("format EVT") != std::string::npos)
    return false;
  size_t at = 0;
  while (at < head.size() && head[at] == '%') {
    at = head.find('\n', at);
    if (at == std::string::npos) return false;
    ++at;
  }
  return at + 1 < head.size() && (head[at] == 0 || head[at] == 12) && head[at + 1] == 8 &&
         head.find("Version") != std::string::npos;
}

/// Rejects known formats that are not supported.
void refuse_foreign(const fs::path& path, const std::string& head) {
  const auto refuse = [&](const char* what, const char* remedy) {
    throw DataError(concat(path.string(), ": is ", what, ", which is not read; ", remedy));
  };
  if (begins(head, "#!AER-DAT")) {
    refuse("AEDAT 1.0 or 3.0",
           "convert it to .aedat4: open it in DV (inivation.com) and record it");
  }
  if (begins(head, "#ROSBAG V1")) refuse("a ROS bag of version 1.x", "run rosbag fix on it");
}

/// Ending in lower case, without that of gzip.
std::string ending_of(const fs::path& path, bool is_packed) {
  const fs::path name = is_packed && path.extension() == ".gz" ? path.stem() : path;
  return in_small_letters(name.extension().string());
}

Format file_format(const fs::path& path) {
  const std::string head = head_of(path);
  const bool is_packed = io::is_gzip(head);
  const std::string kind = ending_of(path, is_packed);
  const bool is_list = kind == ".txt" || kind == ".csv" || kind == ".tsv";
  if (is_packed && is_list) return Format::kText;
  if (const std::string other = io::stand_in(head, path); !other.empty())
    throw DataError(concat(path.string(), ": ", kReadable, ", found ", other));
  for (const char* version : {"#!AER-DAT4", "#!AER-DAT3.1", "#!AER-DAT2.0"}) {
    if (begins(head, version)) return Format::kAedat;
  }
  if (begins(head, "#ROSBAG V2")) return Format::kRosBag;
  if (begins(head, std::string("SQLite format 3\0", 16)) || begins(head, "\x89MCAP0"))
    return Format::kRosBag;
  refuse_foreign(path, head);
  if (is_dat(head)) return Format::kDat;
  if (begins(head, "% ") && !is_list) return Format::kEvt;
  if (begins(head, "\x93NUMPY")) return Format::kNpy;
  if (begins(head, "\x89HDF")) return Format::kHdf5;
  if (begins(head, "PK")) return zip_format(path);
  if (is_text(without_mark(head))) {
    for (const char* other :
         {".aedat", ".aedat4", ".bag", ".db3", ".mcap", ".h5", ".hdf5", ".npz", ".npy"}) {
      if (kind != other) continue;
      throw DataError(concat(path.string(), ": expected what a camera writes under such a name, ",
                             "found text; copy it again, or name a list of events .txt or .csv"));
    }
    return Format::kText;
  }
  if (kind == ".raw") {
    throw DataError(concat(path.string(),
                           ": expected a Prophesee header of lines that begin with "
                           "'%', found none; record or export it again"));
  }
  throw DataError(concat(path.string(), ": ", kReadable, ", found another kind of file"));
}

/// Whether a file's content is that of a recording, and not text.
bool is_recording(const fs::path& path) {
  try {
    return file_format(path) != Format::kText;
  } catch (const DataError&) {
    return false;
  }
}

/// The only recording that a camera wrote, or its archive, in a folder without images; empty: none
/// or several.
fs::path only_recording(const fs::path& folder) {
  std::vector<fs::path> found;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    const std::string name = in_small_letters(entry->path().filename().string());
    for (const char* kind :
         {".aedat", ".aedat4", ".bag", ".mcap", ".db3", ".dat", ".raw", ".zip"}) {
      if (name[0] != '.' && has_ending(name, kind) && is_file(entry->path()))
        found.push_back(entry->path());
    }
  }
  if (found.size() != 1 || count_images(folder) > 0 || !image_folders(folder).empty() ||
      !is_recording(found.front()))
    return {};
  return found.front();
}

}  // namespace

fs::path recording_in(const fs::path& path) {
  if (!is_folder(path) || is_event_folder(path) ||
      (is_file(path / "metadata.yaml") && holds_bag(path)))
    return path;
  const fs::path only = only_recording(path);
  return only.empty() ? path : only;
}

Format recognise(const fs::path& path) {
  std::error_code ignored;
  if (!fs::exists(path, ignored))
    throw DataError(concat(path.string(), ": no such file or folder"));
  if (!fs::is_directory(path, ignored)) return file_format(path);
  if (is_event_folder(path)) return Format::kFrameFolder;
  if (fs::is_regular_file(path / "metadata.yaml", ignored) && holds_bag(path))
    return Format::kRosBag;
  if (const fs::path only = only_recording(path); !only.empty()) return file_format(only);
  const std::vector<std::string> packed = packed_files(path);
  const std::vector<std::string> others =
      packed.empty() ? unfound_events(path) : std::vector<std::string>();
  std::string hint = "; give the file in it";
  if (!packed.empty()) hint = concat(", but ", packed.front());
  if (!others.empty()) hint = concat("; for its events give one of: ", listing(others));
  throw DataError(concat(path.string(), ": ", kReadable,
                         ", found a folder with neither events nor frames that have times", hint));
}

bool is_recording(const fs::path& path) {
  std::error_code ignored;
  // A folder with poses is a data set.
  for (const char* poses : {"poses_bounds.npy", "transforms.json", "transforms_train.json",
                            "sparse", "colmap/sparse"}) {
    if (fs::exists(path / poses, ignored)) return false;
  }
  if (io::is_colmap_model(path)) return false;
  try {
    recognise(path);
    return true;
  } catch (const DataError&) {
    return false;
  }
}

}  // namespace jade::recording
