// SPDX-License-Identifier: Apache-2.0
#include "jade/recording/exposures.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <initializer_list>
#include <set>
#include <sstream>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/text.h"
#include "jade/io/text.h"
#include "jade/recording/contents.h"

namespace jade::recording {
namespace {

std::string trimmed(const std::string& text) {
  const auto first = text.find_first_not_of(" \t\r\"");
  if (first == std::string::npos) return "";
  return text.substr(first, text.find_last_not_of(" \t\r\"") - first + 1);
}

/// "5000", or "5000.0" as in tables of floats.
bool parse_whole(const std::string& text, int64_t* out) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), *out);
  if (error != std::errc()) return false;
  const std::string rest(end, text.data() + text.size());
  return rest.empty() || (rest[0] == '.' && rest.find_first_not_of('0', 1) == std::string::npos);
}

/// Whether a text begins like a number.
bool is_numeric(const std::string& text) {
  return !text.empty() && text.find_first_of("0123456789") <= 1 &&
         text.find_first_not_of("0123456789.+-eE") == std::string::npos;
}

/// Splits a line into three columns, at the separator that leaves numbers in the last two, else at
/// the first that occurs twice. The name may contain it. False for fewer columns.
bool split_line(const std::string& line, std::array<std::string, 3>* out) {
  bool split = false;
  for (const char separator : {',', ';', '\t'}) {
    const auto last = line.rfind(separator);
    if (last == std::string::npos || last == 0) continue;
    const auto first = line.rfind(separator, last - 1);
    if (first == std::string::npos) continue;
    std::array<std::string, 3> columns{trimmed(line.substr(0, first)),
                                       trimmed(line.substr(first + 1, last - first - 1)),
                                       trimmed(line.substr(last + 1))};
    for (const size_t number : {size_t(1), size_t(2)}) {
      if (separator != ',') columns[number] = io::with_point(columns[number]);
    }
    const bool numeric = is_numeric(columns[1]) && is_numeric(columns[2]);
    if (!split || numeric) *out = columns;
    split = true;
    if (numeric) break;
  }
  return split;
}

bool is_one_of(const std::string& word, std::initializer_list<const char*> words) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

/// Meaning of the third column.
enum class Third { kEnd, kLength };

/// @throws DataError naming an unknown column.
Third read_header(const std::string& at, std::array<std::string, 3> columns) {
  for (std::string& name : columns) name = in_small_letters(name);
  if (const auto further = columns[0].find_first_of(",;\t"); further != std::string::npos) {
    throw DataError(concat(at, ": expected three columns, name,start_us,end_us, found more: \"",
                           columns[0], "\" before \"", columns[1], "\"; leave the others out"));
  }
  if (is_one_of(columns[1], {"start_us", "start", "begin_us", "begin", "t_start_us", "t_start"})) {
    if (is_one_of(columns[2], {"end_us", "end", "stop_us", "stop", "t_end_us", "t_end"}))
      return Third::kEnd;
    if (is_one_of(columns[2], {"duration_us", "duration", "length_us", "length", "exposure_us",
                               "exposure", "exposure_time_us"}))
      return Third::kLength;
    throw DataError(concat(at, ": expected the column end_us or duration_us, found \"", columns[2],
                           "\"; give whole microseconds and name the column so"));
  }
  throw DataError(concat(at, ": expected the columns name,start_us,end_us, found \"", columns[1],
                         "\" as the second; give whole microseconds and name the columns so"));
}

/// False for other lines.
bool parse_exposure(const std::array<std::string, 3>& columns, NamedExposure* out) {
  out->name = columns[0];
  return !out->name.empty() && parse_whole(columns[1], &out->start_us) &&
         parse_whole(columns[2], &out->end_us);
}

}  // namespace

events::TimeWindow exposure_at(int64_t t_us, int64_t length_us, Stamp stamp) {
  const int64_t before = stamp == Stamp::kStart    ? 0
                         : stamp == Stamp::kMiddle ? length_us / 2
                                                   : length_us;
  return {t_us - before, t_us - before + length_us};
}

std::vector<events::TimeWindow> exposures_of(const Triggers& triggers, TriggerLevel level) {
  const bool high = level == TriggerLevel::kHigh;
  const auto& starts = high ? triggers.rising_us : triggers.falling_us;
  const auto& ends = high ? triggers.falling_us : triggers.rising_us;
  std::vector<events::TimeWindow> out;
  for (size_t i = 0; i < starts.size(); ++i) {
    const auto end = std::upper_bound(ends.begin(), ends.end(), starts[i]);
    if (end == ends.end()) break;
    // If the next start comes first, the end of this exposure was lost.
    if (i + 1 < starts.size() && starts[i + 1] < *end) continue;
    out.push_back({starts[i], *end});
  }
  return out;
}

std::vector<NamedExposure> read_exposures(const std::filesystem::path& path) {
  std::istringstream text(io::read_text(path));
  std::vector<NamedExposure> out;
  std::set<std::string> names;
  int64_t number = 0;
  Third third = Third::kEnd;
  bool headed = false;
  for (std::string line; std::getline(text, line);) {
    ++number;
    if (trimmed(line).empty() || trimmed(line)[0] == '#') continue;
    NamedExposure row;
    std::array<std::string, 3> columns;
    const bool split = split_line(line, &columns);
    if (split && !headed && out.empty() && !is_numeric(columns[1]) && !is_numeric(columns[2])) {
      third = read_header(concat(path.string(), ":", number), columns);
      headed = true;
      continue;
    }
    if (!split || !parse_exposure(columns, &row)) {
      throw DataError(
          concat(path.string(), ":", number,
                 ": expected \"name,start_us,end_us\" with whole microseconds, found \"",
                 trimmed(line).substr(0, 60), "\"; correct the line"));
    }
    if (third == Third::kLength) row.end_us += row.start_us;
    if (row.end_us < row.start_us) {
      throw DataError(concat(path.string(), ":", number, ": ", row.name, " ends at ", row.end_us,
                             " us, before its start at ", row.start_us,
                             " us; swap the two, or name the third column duration_us if it is ",
                             "the length"));
    }
    if (!names.insert(row.name).second) {
      throw DataError(
          concat(path.string(), ":", number, ": ", row.name, " is listed twice; keep one line"));
    }
    out.push_back(std::move(row));
  }
  return out;
}

void write_exposures(const std::filesystem::path& path,
                     const std::vector<NamedExposure>& exposures) {
  std::string text = "name,start_us,end_us\n";
  for (const auto& row : exposures)
    text += concat(row.name, ",", row.start_us, ",", row.end_us, "\n");
  write_file(path, text);
}

}  // namespace jade::recording
