// SPDX-License-Identifier: Apache-2.0
// Lists of numbers that public data sets have beside their frames, one line per frame in the order
// of the names:
//   DSEC     images/left/exposure_timestamps.txt "start, end", images/timestamps.txt, both in us;
//            downloaded as SEQUENCE_image_exposure_timestamps_left.txt,
//            SEQUENCE_image_timestamps.txt
//   EDS      images_timestamps.txt in us, times.txt "number seconds milliseconds" as DSO reads it;
//            KITTI's times.txt has the seconds only
//   VECtor   left_camera/timestamp.txt "start end" in s
//   TUM-VIE  left_images/image_timestamps_left.txt, image_exposures_left.txt, both in us
#include <algorithm>
#include <charconv>
#include <cmath>
#include <set>
#include <sstream>
#include <string>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/core/text.h"
#include "jade/io/text.h"
#include "jade/recording/contents.h"

namespace jade::recording {
namespace {

namespace fs = std::filesystem;
using events::TimeUnit;

/// The numbers of a line.
using Row = std::vector<double>;

/// A list that was found; no rows: none.
struct NumberList {
  fs::path path;
  std::vector<Row> rows;
};

std::string file_name(const FrameFile& file) { return file.path.filename().string(); }

/// The words of a folder's name: "SEQUENCE_images_left" has three.
std::vector<std::string> name_words(const fs::path& folder) {
  std::string name = in_small_letters(folder.filename().string());
  std::replace_if(
      name.begin(), name.end(), [](char c) { return c == '_' || c == '-' || c == '.'; }, ' ');
  std::istringstream text(name);
  std::vector<std::string> words;
  for (std::string word; text >> word;) words.push_back(word);
  return words;
}

/// "left" or "right": the camera whose frames a folder has.
std::string side_of(const fs::path& images) {
  const fs::path whole = fs::absolute(images).lexically_normal();
  for (const fs::path& part : {whole, whole.parent_path()}) {
    const std::vector<std::string> words = name_words(part);
    if (std::find(words.begin(), words.end(), "right") != words.end()) return "right";
  }
  return "left";
}

/// Whether one of the first two lines has a number.
bool has_numbers(const fs::path& list) {
  std::istringstream text(io::read_text(list));
  int lines = 0;
  for (std::string line; lines < 2 && std::getline(text, line);) {
    const auto first = line.find_first_not_of(" \t\r");
    if (first == std::string::npos || line[first] == '#') continue;
    ++lines;
    std::replace_if(
        line.begin(), line.end(), [](char c) { return c == ',' || c == ';'; }, ' ');
    std::istringstream words(line);
    for (std::string word; words >> word;) {
      if (number_in(io::with_point(word))) return true;
    }
  }
  return false;
}

/// The first file with one of these names, nearest to the images first; else the only one whose
/// name ends in `ending`. Empty if there is none.
/// @param ending  of names that begin with that of a sequence; empty: there are none
/// @throws DataError if several files have such an ending.
fs::path find_list(const std::vector<fs::path>& folders, const std::vector<std::string>& names,
                   const std::string& ending = "") {
  for (const fs::path& folder : folders) {
    for (const std::string& name : names) {
      // Above the images such a name may be that of notes.
      if (is_file(folder / name) && (folder == folders.front() || has_numbers(folder / name)))
        return folder / name;
    }
    std::vector<std::string> found;
    std::error_code error;
    for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
         entry.increment(error)) {
      const std::string name = entry->path().filename().string();
      if (name[0] != '.' && !ending.empty() && has_ending(name, ending)) found.push_back(name);
    }
    std::sort(found.begin(), found.end());
    if (found.size() == 1) return folder / found.front();
    if (found.empty()) continue;
    throw DataError(concat(folder.string(), ": expected one list of times for the frames, found ",
                           found[0], " and ", found[1], "; rename that of the frames to ",
                           names.front()));
  }
  return {};
}

/// The numbers of a line, separated by blanks, semicolons or tabs, else by commas. No value for
/// other text, but for a file name after two numbers or more.
std::optional<Row> numbers_of(std::string line) {
  const bool is_parted = line.find_first_of(";\t") != std::string::npos;
  std::replace_if(
      line.begin(), line.end(),
      [&](char c) { return c == ';' || c == '\r' || (c == ',' && !is_parted); }, ' ');
  Row row;
  std::istringstream words(line);
  for (std::string word; words >> word;) {
    const std::optional<double> value = number_in(io::with_point(word));
    if (!value) {
      if (row.size() < 2) return std::nullopt;
      break;
    }
    row.push_back(*value);
  }
  return row;
}

struct NamedTime {
  std::string name;
  double time = 0;
};

/// The time and the name of a line with one number, before or behind a name. No value for others.
std::optional<NamedTime> named_time_of(const std::string& line) {
  const bool is_parted = line.find_first_of(";\t") != std::string::npos;
  const std::string separators = is_parted ? " \t\r;\"" : " \t\r;\",";
  std::vector<std::string> words;
  std::vector<size_t> begins;
  for (size_t begin = line.find_first_not_of(separators); begin != std::string::npos;) {
    const size_t end = std::min(line.find_first_of(separators, begin), line.size());
    words.push_back(io::with_point(line.substr(begin, end - begin)));
    begins.push_back(begin);
    begin = line.find_first_not_of(separators, end);
  }
  const auto is_number = [](const std::string& word) { return number_in(word).has_value(); };
  if (words.size() < 2 || std::count_if(words.begin(), words.end(), is_number) != 1)
    return std::nullopt;
  const bool is_first = is_number(words.front());
  if (!is_first && !is_number(words.back())) return std::nullopt;
  const std::string name =
      is_first ? line.substr(begins[1]) : line.substr(begins[0], begins.back() - begins[0]);
  return NamedTime{name.substr(0, name.find_last_not_of(separators) + 1),
                   *number_in(is_first ? words.front() : words.back())};
}

/// @param least,most  numbers per line
/// @throws DataError naming a line that has fewer or more.
NumberList read_list(const fs::path& path, size_t least, size_t most) {
  NumberList list{path, {}};
  if (path.empty()) return list;
  std::istringstream text(io::read_text(path));
  int64_t number = 0;
  bool is_first = true;
  for (std::string line; std::getline(text, line);) {
    ++number;
    const auto first = line.find_first_not_of(" \t\r");
    if (first == std::string::npos || line[first] == '#') continue;
    const std::optional<Row> row = numbers_of(line);
    const bool is_header = !row && is_first;
    is_first = false;
    if (is_header) continue;
    const size_t wanted = list.rows.empty() ? least : list.rows.front().size();
    if (!row || row->size() < wanted || row->size() > (list.rows.empty() ? most : wanted)) {
      throw DataError(concat(path.string(), ":", number, ": expected ", wanted,
                             wanted == 1 ? " number" : " numbers", " for a frame, found '",
                             line.substr(0, 60), "'; correct the line"));
    }
    list.rows.push_back(*row);
  }
  return list;
}

/// The number at the end of a file's name; no value for names without.
std::optional<size_t> number_of(const fs::path& file) {
  const std::string name = file.stem().string();
  const size_t first = name.find_last_not_of("0123456789") + 1;
  size_t number = 0;
  if (std::from_chars(name.data() + first, name.data() + name.size(), number).ec != std::errc())
    return std::nullopt;
  return number;
}

/// Whether the first number of each line is that of its frame: numbers that count, or, where frames
/// are missing, whole ones that rise in small steps beside rising times. Starts and ends advance
/// equally, numbers and times do not.
bool has_frame_numbers(const NumberList& list) {
  constexpr double kLargestStep = 100;  // on average
  const std::vector<Row>& rows = list.rows;
  bool is_counted = true, is_rising = rows.size() > 1 && rows[0].size() > 1;
  for (size_t i = 0; i < rows.size(); ++i) {
    is_counted = is_counted && rows[i][0] == rows[0][0] + double(i);
    if (i == 0 || !is_rising) continue;
    is_rising = rows[i][0] == std::floor(rows[i][0]) && rows[i][0] > rows[i - 1][0] &&
                rows[i][1] > rows[i - 1][1];
  }
  if (is_counted || !is_rising) return is_counted;
  const double counted = rows.back()[0] - rows[0][0], timed = rows.back()[1] - rows[0][1];
  const bool is_exposed = timed > 0.5 * counted && timed < 2 * counted;
  return !is_exposed && counted < kLargestStep * double(rows.size() - 1);
}

/// The number of the frame that a list of more or fewer lines than frames begins with: its own, or
/// 0; 1 if the last line is that of the last frame, which is counted so.
/// Lists of exposures, as DSEC's, count from 0.
/// @throws DataError if frames counted from 1 may begin with the first time or the second.
double first_number(const NumberList& list, const std::vector<FrameFile>& files) {
  if (list.rows[0].size() > 1 && has_frame_numbers(list)) return list.rows[0][0];
  size_t least = SIZE_MAX, most = 0;
  for (const FrameFile& file : files) {
    const size_t number = number_of(file.path).value_or(0);
    least = std::min(least, number), most = std::max(most, number);
  }
  if (least >= 1 && most == list.rows.size()) return 1;
  if (least != 1 || most > list.rows.size() || list.rows[0].size() > 1) return 0;
  throw DataError(concat(list.path.string(), ": expected one line per frame, found ",
                         list.rows.size(), " lines for ", files.size(), " frames counted from 1, ",
                         "of which the first may have the first line or the second; remove the ",
                         "lines without a frame, or give names with --frame-times"));
}

/// The row of each file: in the order of names or, of a part of the frames, by their numbers.
/// @throws DataError if a file has no row.
std::vector<Row> rows_of(const NumberList& list, const std::vector<FrameFile>& files,
                         std::vector<std::string>& notes) {
  if (list.rows.size() == files.size()) return list.rows;
  const double first = first_number(list, files);
  const bool is_numbered = list.rows[0].size() > 1 && has_frame_numbers(list);
  std::vector<Row> out;
  for (const FrameFile& file : files) {
    const std::optional<size_t> number = number_of(file.path);
    double line = number ? double(*number) - first : -1;
    if (number && is_numbered) {
      const auto found = std::find_if(list.rows.begin(), list.rows.end(),
                                      [&](const Row& row) { return row[0] == double(*number); });
      line = double(found - list.rows.begin());
    }
    if (line < 0 || line >= double(list.rows.size())) {
      throw DataError(concat(list.path.string(), ": expected one line per frame, found ",
                             list.rows.size(), " lines for ", files.size(),
                             " frames, and none for ", file_name(file),
                             "; add the frames or their lines"));
    }
    out.push_back(list.rows[size_t(line)]);
  }
  notes.push_back(concat(list.path.string(), ": has ", list.rows.size(), " lines for ",
                         files.size(), " frames; each frame has the line of its number, from ",
                         first));
  return out;
}

/// Times in us of one column.
std::vector<int64_t> column_us(const std::vector<Row>& rows, size_t column, TimeUnit unit,
                               const fs::path& list, std::vector<std::string>& notes) {
  std::vector<double> times;
  for (const Row& row : rows) times.push_back(row[column]);
  if (unit == TimeUnit::kAuto) {
    unit = likely_unit(times).value_or(TimeUnit::kUs);
    if (unit != TimeUnit::kUs) {
      const std::string note =
          concat(list.string(), ": expected times in us, found frames too far ",
                 "apart or too close for that; they are read as ", word_of(unit));
      // Starts and ends are two columns of one unit.
      if (notes.empty() || notes.back() != note) notes.push_back(note);
    }
  }
  return events::times_us(torch::tensor(times, torch::kFloat64), unit, list.string());
}

/// Assigns the exposures of a list of their starts and ends.
/// @param is_assumed  no name and no header says that these are the two times; a warning does
void set_spans(const NumberList& list, TimeUnit unit, bool is_assumed,
               std::vector<FrameFile>& files, Recording& recording) {
  std::vector<std::string>& notes = recording.notes;
  const std::vector<Row> rows = rows_of(list, files, notes);
  const auto starts = column_us(rows, 0, unit, list.path, notes);
  const auto ends = column_us(rows, 1, unit, list.path, notes);
  for (size_t i = 0; i < files.size(); ++i) {
    files[i].time = events::TimeWindow{starts[i], ends[i]};
    if (starts[i] <= ends[i]) continue;
    throw DataError(concat(list.path.string(), ": ", file_name(files[i]), " ends at ", ends[i],
                           " us, before its start at ", starts[i], " us; swap the two"));
  }
  if (is_assumed) {
    std::vector<int64_t> lengths;
    for (size_t i = 0; i < files.size(); ++i) lengths.push_back(ends[i] - starts[i]);
    const auto median = lengths.begin() + std::ptrdiff_t(lengths.size() / 2);
    std::nth_element(lengths.begin(), median, lengths.end());
    recording.warnings.push_back(concat(
        list.path.string(), ": two times per frame without a header are read as the start ",
        "and the end of its exposure, median length ", *median, " us; if they are times of ",
        "two clocks, as of the sensor and of arrival, keep one column, else write the first ",
        "line '# start end'"));
  } else {
    notes.push_back(concat(list.path.string(), ": has the exposures of the frames"));
  }
  check_apart(list.path, files, recording);
}

/// Reads DSEC's list of exposures. False if there is none.
bool add_spans(const std::vector<fs::path>& folders, const std::string& side, TimeUnit unit,
               std::vector<FrameFile>& files, Recording& recording) {
  const std::string whole = "image_exposure_timestamps_" + side + ".txt";
  const NumberList list = read_list(
      find_list(folders, {"exposure_timestamps.txt", "exposure_timestamps_" + side + ".txt", whole},
                "_" + whole),
      2, 2);
  if (list.rows.empty()) return false;
  set_spans(list, unit, false, files, recording);
  return true;
}

/// Whether the first line of a list has one or two numbers and nothing else.
bool has_no_names(const fs::path& path) {
  std::istringstream text(io::read_text(path));
  bool is_first = true;
  for (std::string line; std::getline(text, line);) {
    const auto begin = line.find_first_not_of(" \t\r");
    if (begin == std::string::npos || line[begin] == '#') continue;
    const std::optional<Row> row = numbers_of(line);
    const bool is_header = !row && is_first;
    is_first = false;
    if (is_header) continue;
    return row && (row->size() == 1 || row->size() == 2) &&
           line.find_first_not_of("0123456789.,;+-eE \t\r") == std::string::npos;
  }
  return false;
}

/// Whether the first line of a list is a header that names a time.
bool has_column_of_times(const fs::path& path) {
  std::istringstream text(io::read_text(path));
  std::string header;
  std::getline(text, header);
  return in_small_letters(header).find("time") != std::string::npos;
}

/// Lengths of the exposures, in us.
struct Lengths {
  fs::path path;  ///< empty: they are not known
  std::vector<int64_t> us;
};

Lengths find_lengths(const std::vector<fs::path>& folders, const std::string& side,
                     const NumberList& dso, const std::vector<FrameFile>& files,
                     std::vector<std::string>& notes) {
  const NumberList list = read_list(find_list(folders, {"image_exposures_" + side + ".txt"}), 1, 1);
  Lengths out;
  if (!list.rows.empty()) {
    out = {list.path, column_us(rows_of(list, files, notes), 0, TimeUnit::kUs, list.path, notes)};
  } else if (!dso.rows.empty() && dso.rows.front().size() >= 3) {
    out = {dso.path, column_us(rows_of(dso, files, notes), 2, TimeUnit::kMs, dso.path, notes)};
  }
  for (size_t i = 0; i < out.us.size(); ++i) {
    if (out.us[i] >= 0) continue;
    throw DataError(concat(out.path.string(), ": expected exposures of 0 us and more, found ",
                           out.us[i], " us for ", file_name(files[i]), "; correct the line"));
  }
  return out;
}

/// The lines before the first number of a list, in small letters.
std::string header_of(const fs::path& path) {
  std::istringstream text(io::read_text(path));
  std::string header;
  for (std::string line; std::getline(text, line);) {
    const auto first = line.find_first_not_of(" \t\r");
    if (first == std::string::npos) continue;
    if (line[first] != '#' && numbers_of(line)) break;
    header += in_small_letters(line) + '\n';
  }
  return header;
}

/// Whether a list of times has the start and the end of each exposure: pairs that rise, each before
/// the next, below no header of other columns.
bool are_spans(const NumberList& list, const std::string& header) {
  const std::vector<Row>& rows = list.rows;
  if (rows.size() < 2 || rows.front().size() != 2 || has_frame_numbers(list)) return false;
  const auto names = [&](const char* word) { return header.find(word) != std::string::npos; };
  if (!header.empty() && !names("start") && !names("begin") && !names("exposure")) return false;
  for (size_t i = 0; i < rows.size(); ++i) {
    if (rows[i][0] >= rows[i][1] || (i > 0 && rows[i - 1][1] > rows[i][0])) return false;
  }
  return true;
}

/// VECtor's list, whose name lists and notes of other things have too: empty, with a note, unless
/// it has one line of one or two numbers for each frame.
NumberList list_of_each(const fs::path& path, const std::vector<FrameFile>& files,
                        std::vector<std::string>& notes) {
  if (path.empty()) return {};
  std::string found = "other text";
  try {
    NumberList list = read_list(path, 1, 2);
    const size_t count = list.rows.size();
    if (count == files.size()) return list;
    if (count > 0) found = concat(count, count == 1 ? " line" : " lines");
  } catch (const DataError&) {
  }
  notes.push_back(concat(path.string(), ": expected one time, or start and end, for each of ",
                         files.size(), " frames, found ", found, "; it is not used; if it has the ",
                         "times of the frames, name it timestamps.txt"));
  return {};
}

/// The column of the times, before which the frames may be counted.
/// @throws DataError naming a line with two numbers that do not count.
size_t time_column(const NumberList& list) {
  if (list.rows.front().size() == 1) return 0;
  if (has_frame_numbers(list)) return 1;
  throw DataError(concat(list.path.string(), ": expected one time per frame, found ",
                         list.rows[0][0], " and ", list.rows[0][1],
                         " for the first; write one number per line, with a decimal point, or, if "
                         "these are the start and end of its exposure, give the file with "
                         "--frame-times"));
}

void note_single_times(const fs::path& list, Recording& recording) {
  recording.notes.push_back(concat(list.string(), ": has one time per frame; it is taken as the ",
                                   word_of(recording.stamp), " of the exposure"));
}

}  // namespace

std::optional<double> number_in(const std::string& word) {
  double value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error != std::errc() || end != word.data() + word.size() || !std::isfinite(value))
    return std::nullopt;
  return value;
}

std::vector<fs::path> list_folders(const fs::path& images, const fs::path& root) {
  const auto whole = [](const fs::path& folder) {
    const fs::path path = fs::absolute(folder).lexically_normal();
    return path.has_filename() ? path : path.parent_path();
  };
  std::vector<fs::path> out{whole(images)};
  while (!root.empty() && out.back() != whole(root) && out.back().has_relative_path())
    out.push_back(out.back().parent_path());
  while (root.empty() && out.size() < 3) {
    const std::vector<std::string> words = name_words(out.back());
    const auto has = [&](const char* word) {
      return std::find(words.begin(), words.end(), word) != words.end();
    };
    const bool is_side = !words.empty() && (words.back() == "left" || words.back() == "right");
    const bool is_part = is_side || has("image") || has("images") || has("img") || has("imgs") ||
                         has("frame") || has("frames") || has("rgb") || has("aps") ||
                         has("rectified") || has("distorted") || has("data") || has("camera");
    if (!is_part) break;
    out.push_back(out.back().parent_path());
  }
  return out;
}

std::vector<fs::path> lists_beside(const fs::path& frames) {
  const bool is_one_file = !is_folder(frames);
  std::vector<fs::path> folders = list_folders(is_one_file ? frames.parent_path() : frames, {});
  const std::string own = in_small_letters(folders.front().filename().string());
  if (!is_one_file) folders.erase(folders.begin());
  std::vector<fs::path> lists;
  for (const fs::path& folder : folders) {
    std::error_code error;
    for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
         entry.increment(error)) {
      const std::string name = in_small_letters(entry->path().stem().string());
      const std::string kind = in_small_letters(entry->path().extension().string());
      const bool is_named = name.find("time") != std::string::npos ||
                            name.find("exposure") != std::string::npos || name == "images" ||
                            name == "frames" || name == own;
      if (is_named && (kind == ".txt" || kind == ".csv") && is_file(entry->path()))
        lists.push_back(entry->path());
    }
  }
  std::sort(lists.begin(), lists.end());
  return lists;
}

bool apply_numbers(const fs::path& path, const ReadOptions& options, std::vector<FrameFile>& files,
                   Recording& recording) {
  if (!has_no_names(path)) return false;
  const NumberList list = read_list(path, 1, 2);
  const bool single = list.rows.front().size() == 1;
  if (!single && !has_frame_numbers(list)) {
    set_spans(list, options.time_unit, false, files, recording);
    return true;
  }
  const std::vector<int64_t> at = column_us(rows_of(list, files, recording.notes), single ? 0 : 1,
                                            options.time_unit, path, recording.notes);
  for (size_t i = 0; i < files.size(); ++i) files[i].time = events::TimeWindow{at[i], at[i]};
  note_single_times(path, recording);
  check_apart(path, files, recording);
  return true;
}

bool apply_named_times(const fs::path& path, const ReadOptions& options,
                       std::vector<FrameFile>& files, Recording& recording) {
  std::istringstream text(io::read_text(path));
  std::vector<NamedExposure> named;
  std::vector<Row> times;
  std::set<std::string> names;
  int64_t number = 0;
  bool is_first = true;
  for (std::string line; std::getline(text, line);) {
    ++number;
    const auto first = line.find_first_not_of(" \t\r");
    if (first == std::string::npos || line[first] == '#') continue;
    const auto found = named_time_of(line);
    const bool is_header = !found && is_first;
    if (!found && named.empty() && !is_first) return false;
    is_first = false;
    if (is_header) continue;
    if (!found || !names.insert(found->name).second) {
      throw DataError(concat(path.string(), ":", number, ": expected one time and the name of ",
                             found ? "another frame" : "a frame", ", found '", line.substr(0, 60),
                             "'; correct the line"));
    }
    named.push_back({found->name, 0, 0});
    times.push_back({found->time});
  }
  if (named.empty()) return false;
  const auto at = column_us(times, 0, options.time_unit, path, recording.notes);
  for (size_t i = 0; i < named.size(); ++i) named[i].start_us = named[i].end_us = at[i];
  note_single_times(path, recording);
  apply_exposures(path, named, files, recording);
  return true;
}

bool add_frame_list(const fs::path& images, const fs::path& root, const ReadOptions& options,
                    std::vector<FrameFile>& files, Recording& recording) {
  if (files.empty()) return false;
  const std::vector<fs::path> folders = list_folders(images, root);
  const std::string side = side_of(images);
  std::vector<std::string>& notes = recording.notes;
  if (add_spans(folders, side, options.time_unit, files, recording)) return true;
  const fs::path list = find_list(folders,
                                  {"image_timestamps_" + side + ".txt", "images_timestamps.txt",
                                   "image_timestamps.txt", "timestamps.txt"},
                                  "_image_timestamps.txt");
  const fs::path times = find_list(folders, {"times.txt"});
  fs::path csv = list.empty() ? find_list(folders, {"frames.csv"}) : fs::path();
  // Lists of other things have this name too.
  if (!csv.empty() && !has_no_names(csv) && !has_column_of_times(csv)) csv.clear();
  const fs::path lone = find_list(folders, {"timestamp.txt"});
  const fs::path other = !list.empty() ? list : !csv.empty() ? csv : times;
  if (!lone.empty() && !other.empty())
    notes.push_back(concat(lone.string(), ": is not used beside ", other.string()));
  if (!list.empty() && !has_no_names(list) && apply_named_times(list, options, files, recording))
    return true;
  const NumberList dso = read_list(times, 1, 5);
  NumberList stamps = read_list(list, 1, 2);
  if (!csv.empty() && has_no_names(csv)) {
    stamps = read_list(csv, 1, 2);
  } else if (!csv.empty() && apply_named_times(csv, options, files, recording)) {
    return true;
  }
  if (other.empty()) stamps = list_of_each(lone, files, notes);
  const NumberList& source = stamps.rows.empty() ? dso : stamps;
  if (source.rows.empty()) return add_times_of_names(images, options, files, recording);
  const std::string header = header_of(source.path);
  if (are_spans(source, header)) {
    set_spans(source, options.time_unit, header.empty(), files, recording);
    return true;
  }
  const bool is_dso = &source == &dso && source.rows.front().size() > 1;
  const size_t column = is_dso ? 1 : time_column(source);
  const std::vector<int64_t> at =
      column_us(rows_of(source, files, notes), column, is_dso ? TimeUnit::kS : options.time_unit,
                source.path, notes);
  const Lengths lengths = find_lengths(folders, side, dso, files, notes);
  const Stamp stamp = options.stamp.value_or(recording.stamp);
  for (size_t i = 0; i < files.size(); ++i)
    files[i].time = exposure_at(at[i], lengths.us.empty() ? 0 : lengths.us[i], stamp);
  notes.push_back(concat(source.path.string(), ": has one time per frame; it is taken as the ",
                         word_of(stamp), " of the exposure",
                         lengths.path.empty()
                             ? ""
                             : concat(", whose length is in ", lengths.path.filename().string())));
  check_apart(lengths.path.empty() ? source.path : lengths.path, files, recording);
  return true;
}

}  // namespace jade::recording
