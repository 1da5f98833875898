// SPDX-License-Identifier: Apache-2.0
#include "jade/events/columns.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <limits>
#include <map>

#include "jade/core/error.h"
#include "jade/core/text.h"

namespace jade::events {
namespace {

/// Minimum number of rows to recognise columns by their values.
constexpr size_t kTelling = 8;
/// Upper bound of coordinates.
constexpr double kLargestPlace = 65535;

/// Trims blanks and quotes and converts to lower case.
std::string plain_word(const std::string& name) {
  constexpr const char* kAround = " \t\r\"'#%";
  const size_t begin = name.find_first_not_of(kAround);
  if (begin == std::string::npos) return "";
  return in_small_letters(name.substr(begin, name.find_last_not_of(kAround) + 1 - begin));
}

struct ColumnRange {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  bool falls = false, has_fraction = false;
  size_t signs = 0;  ///< values that are -1, 0 or 1
  bool rises(const std::vector<Row>& rows, size_t c) const {
    return !falls && rows.front()[c] < rows.back()[c];
  }
};

std::array<ColumnRange, 4> ranges_of(const std::vector<Row>& rows) {
  std::array<ColumnRange, 4> out;
  for (size_t c = 0; c < 4; ++c) {
    double before = -std::numeric_limits<double>::infinity();
    for (const Row& row : rows) {
      const double v = row[c];
      out[c].low = std::min(out[c].low, v), out[c].high = std::max(out[c].high, v);
      out[c].falls |= v < before;
      out[c].has_fraction |= v != std::floor(v);
      out[c].signs += v == 0 || v == 1 || v == -1;
      before = v;
    }
  }
  return out;
}

/// Polarity is the last column: only the time remains to be found.
Columns with_time(size_t time, size_t polarity) {
  Columns out{};
  size_t place = 0;
  for (size_t c = 0; c < 4; ++c) {
    if (c != time && c != polarity) out[place++] = c;
  }
  out[2] = time, out[3] = polarity;
  return out;
}

/// The field as event_field() finds it, or by a name in words; a row is a y.
int field_in_words(const std::string& name) {
  static const std::map<std::string, int> known{
      {"u", 0},      {"px", 0},      {"col", 0},        {"cols", 0},
      {"column", 0}, {"columns", 0}, {"horizontal", 0}, {"v", 1},
      {"py", 1},     {"row", 1},     {"rows", 1},       {"vertical", 1},
      {"stamp", 2},  {"clock", 2},   {"timestamp", 2},  {"polarization", 3},
      {"sign", 3},   {"signs", 3},   {"ison", 3},       {"onoff", 3}};
  static const char* const fillers[] = {"coordinates", "coordinate", "coords", "coord", "address",
                                        "addr",        "position",   "pixels", "pixel", "pos",
                                        "index",       "idx",        "event",  "ev",    "px"};
  if (const int field = event_field(name); field >= 0) return field;
  const std::string plain = plain_word(name.substr(0, name.find_first_of("[(")));
  if (unit_of_word(plain) && plain != "s") return 2;
  std::string word;
  for (const char c : plain) {
    if (std::isalnum(static_cast<unsigned char>(c)) != 0) word += c;
  }
  const auto field_of = [&](const std::string& text) {
    const auto found = known.find(text);
    return found != known.end() ? found->second : event_field(text);
  };
  if (const int field = field_of(word); field >= 0) return field;
  for (const std::string filler : fillers) {
    if (word.size() <= filler.size()) continue;
    const size_t rest = word.size() - filler.size();
    int field = -1;
    if (word.compare(rest, filler.size(), filler) == 0) field = field_of(word.substr(0, rest));
    if (field < 0 && word.compare(0, filler.size(), filler) == 0)
      field = field_of(word.substr(filler.size()));
    if (field >= 0) return field;
  }
  return -1;
}

/// The columns that `field_of` finds by name; no value unless each of the four appears once.
template <class FieldOf>
std::optional<Columns> columns_by(const std::vector<std::string>& names, const FieldOf& field_of) {
  Columns columns{};
  std::array<bool, 4> found{};
  for (size_t i = 0; i < names.size(); ++i) {
    const int field = field_of(names[i]);
    if (field < 0) continue;
    if (found[size_t(field)]) return std::nullopt;
    found[size_t(field)] = true;
    columns[size_t(field)] = i;
  }
  const bool all = std::all_of(found.begin(), found.end(), [](bool f) { return f; });
  return all ? std::optional(columns) : std::nullopt;
}

class ColumnSearch {
 public:
  ColumnSearch(const std::vector<Row>& rows, Preference preference, const std::string& where,
               const std::string& mend)
      : rows_(rows),
        ranges_(ranges_of(rows)),
        preference_(preference),
        where_(where),
        mend_(mend) {}

  Columns find() const {
    if (rows_.size() < kTelling) return few();
    const size_t p = polarity();
    const Columns out = with_time(time(p), p);
    for (const size_t axis : {out[0], out[1]}) {
      if (ranges_[axis].high > kLargestPlace || ranges_[axis].low < -kLargestPlace)
        refuse("two columns of pixels");
    }
    return out;
  }

 private:
  Columns few() const {
    if (rows_.empty()) return kTimeFirst;
    const bool first = ranges_[0].rises(rows_, 0), third = ranges_[2].rises(rows_, 2);
    if (preference_ == Preference::kFirst)
      return third && ranges_[0].falls ? kPlaceFirst : kTimeFirst;
    if (ranges_[0].falls != ranges_[2].falls && (first || third))
      return ranges_[2].falls ? kTimeFirst : kPlaceFirst;
    return ranges_[0].high >= ranges_[2].high ? kTimeFirst : kPlaceFirst;
  }

  /// All values but a few damaged ones are signs.
  bool is_sign(size_t column) const { return 100 * ranges_[column].signs >= 99 * rows_.size(); }

  size_t polarity() const {
    if (is_sign(3)) return 3;
    std::vector<size_t> found;
    for (size_t c = 0; c < 3; ++c) {
      if (is_sign(c)) found.push_back(c);
    }
    if (found.size() == 1) return found[0];
    // If lines have the usual order and a few are damaged, let their reader report the first.
    if (found.empty() && 2 * ranges_[3].signs >= rows_.size()) return 3;
    refuse("one column of polarities, 0/1 or -1/+1");
  }

  size_t time(size_t polarity) const {
    std::vector<size_t> rest, rising, fractions;
    for (size_t c = 0; c < 4; ++c) {
      if (c == polarity) continue;
      rest.push_back(c);
      if (ranges_[c].rises(rows_, c)) rising.push_back(c);
      if (ranges_[c].has_fraction) fractions.push_back(c);
    }
    const auto larger = [&](const std::vector<size_t>& of) {
      return *std::max_element(of.begin(), of.end(), [&](size_t a, size_t b) {
        return ranges_[a].high < ranges_[b].high;
      });
    };
    if (rising.size() == 1) return rising[0];
    if (rising.size() > 1) {
      if (preference_ == Preference::kFirst && rising[0] == 0) return 0;
      return larger(rising);
    }
    if (ranges_[larger(rest)].high > kLargestPlace) return larger(rest);
    if (fractions.size() == 1) return fractions[0];
    if (polarity != 3) refuse("one column of times that never decrease");
    if (preference_ == Preference::kFirst) return 0;
    return ranges_[0].high >= ranges_[2].high ? 0 : 2;
  }

  [[noreturn]] void refuse(const char* expected) const {
    std::string found;
    for (size_t c = 0; c < 4; ++c) {
      found += concat(c == 0 ? "" : ", ", "column ", c + 1, " from ", ranges_[c].low, " to ",
                      ranges_[c].high, ranges_[c].rises(rows_, c) ? " rising" : "");
    }
    throw DataError(concat(where_, ": expected ", expected, " among the four of an event, found ",
                           found, "; ", mend_));
  }

  const std::vector<Row>& rows_;
  std::array<ColumnRange, 4> ranges_;
  Preference preference_;
  const std::string &where_, &mend_;
};

}  // namespace

int event_field(const std::string& name) {
  static const std::map<std::string, int> known{
      {"x", 0},    {"xs", 0},        {"y", 1},          {"ys", 1},         {"t", 2}, {"ts", 2},
      {"time", 2}, {"timestamp", 2}, {"times", 2},      {"timestamps", 2}, {"p", 3}, {"ps", 3},
      {"pol", 3},  {"polarity", 3},  {"polarities", 3}, {"on", 3}};
  const std::string word = plain_word(name.substr(0, name.find_first_of("[(")));
  if (const auto found = known.find(word); found != known.end()) return found->second;
  // Only times have a unit after their name: "t_ms".
  const size_t bar = word.rfind('_');
  if (bar == std::string::npos || !unit_of_word(word.substr(bar + 1))) return -1;
  const auto found = known.find(word.substr(0, bar));
  return found != known.end() && found->second == 2 ? 2 : -1;
}

TimeUnit unit_in_name(const std::string& name) {
  std::string word = plain_word(name);
  const auto drop = [&](const char* last) { word.erase(word.find_last_not_of(last) + 1); };
  drop(" \t])");
  const size_t before = word.find_last_of("_[(");
  if (before == std::string::npos || before == 0) return TimeUnit::kAuto;
  const size_t begin = word.find_first_not_of(" \t", before + 1);
  if (begin == std::string::npos) return TimeUnit::kAuto;
  return unit_of_word(word.substr(begin)).value_or(TimeUnit::kAuto);
}

std::optional<std::pair<size_t, size_t>> time_in_two(const std::vector<std::string>& names) {
  const auto named = [&](TimeUnit unit) {
    std::vector<std::pair<std::string, size_t>> found;  // name before the unit, and place
    for (size_t i = 0; i < names.size(); ++i) {
      const std::string word = plain_word(names[i]);
      const size_t mark = word.find_last_of("._/ ");
      const size_t begin = mark == std::string::npos ? 0 : mark + 1;
      const std::optional<TimeUnit> of_word = unit_of_word(word.substr(begin));
      if (of_word == unit && word.substr(begin) != "s" && word.substr(begin) != "ns")
        found.emplace_back(word.substr(0, begin), i);
    }
    return found;
  };
  const auto seconds = named(TimeUnit::kS), nanoseconds = named(TimeUnit::kNs);
  if (seconds.size() != 1 || nanoseconds.size() != 1) return std::nullopt;
  if (seconds[0].first != nanoseconds[0].first) return std::nullopt;
  return std::pair{seconds[0].second, nanoseconds[0].second};
}

std::optional<Columns> named_columns(const std::vector<std::string>& names) {
  if (const auto columns = columns_by(names, event_field)) return columns;
  return columns_by(names, field_in_words);
}

Columns likely_columns(const std::vector<Row>& rows, Preference preference,
                       const std::string& where, const std::string& mend) {
  return ColumnSearch(rows, preference, where, mend).find();
}

}  // namespace jade::events
