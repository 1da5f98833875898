// SPDX-License-Identifier: Apache-2.0
#include "jade/recording/exposures.h"

#include <algorithm>
#include <charconv>
#include <set>
#include <sstream>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/recording/contents.h"

namespace jade::recording {
namespace {

std::string trimmed(const std::string& text) {
  const auto first = text.find_first_not_of(" \t\r\"");
  if (first == std::string::npos) return "";
  return text.substr(first, text.find_last_not_of(" \t\r\"") - first + 1);
}

bool parse_whole(const std::string& text, int64_t* out) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), *out);
  return error == std::errc() && end == text.data() + text.size();
}

/// False for a line of another kind.
bool parse_exposure(const std::string& line, NamedExposure* out) {
  const auto last = line.rfind(',');
  const auto first = last == std::string::npos || last == 0 ? last : line.rfind(',', last - 1);
  if (first == std::string::npos || first == last) return false;
  out->name = trimmed(line.substr(0, first));
  return !out->name.empty() &&
         parse_whole(trimmed(line.substr(first + 1, last - first - 1)), &out->start_us) &&
         parse_whole(trimmed(line.substr(last + 1)), &out->end_us);
}

}  // namespace

std::string without_mark(const std::string& text) {
  return text.rfind("\xEF\xBB\xBF", 0) == 0 ? text.substr(3) : text;
}

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
  std::istringstream text(without_mark(read_file(path)));
  std::vector<NamedExposure> out;
  std::set<std::string> names;
  int64_t number = 0;
  for (std::string line; std::getline(text, line);) {
    ++number;
    if (trimmed(line).empty() || trimmed(line)[0] == '#') continue;
    NamedExposure row;
    if (!parse_exposure(line, &row)) {
      if (out.empty() && trimmed(line).rfind("name", 0) == 0) continue;
      throw DataError(concat(path.string(), ":", number,
                             ": expected \"name,start_us,end_us\" with whole microseconds"));
    }
    if (row.end_us < row.start_us) {
      throw DataError(concat(path.string(), ":", number, ": ", row.name, " ends at ", row.end_us,
                             " us, before its start at ", row.start_us, " us; swap the two"));
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
