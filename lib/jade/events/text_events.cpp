// SPDX-License-Identifier: Apache-2.0
// Lists of events in text: one line per event, four numbers in any order.
#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <fstream>
#include <optional>
#include <torch/types.h>
#include <vector>

#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/core/text.h"
#include "jade/events/columns.h"
#include "jade/events/raw_events.h"
#include "jade/io/gzip.h"
#include "jade/io/stand_in.h"

namespace jade::events {
namespace {

constexpr size_t kTextAtOnce = size_t(1) << 22;
constexpr const char* kNameColumns = "name the columns in a first line such as \"t x y p\"";
constexpr int kMostColumns = 16;
using Numbers = std::array<double, kMostColumns>;

/// Calls `line` with each line of a file, plain or compressed by gzip, which is read in pieces.
template <class Line>
void for_each_line(const std::filesystem::path& path, const Line& line) {
  if (!std::ifstream(path, std::ios::binary)) {
    const std::string other = io::stand_in(path);
    throw DataError(concat(path.string(), other.empty() ? ": no such event file"
                                                        : ": expected events, found " + other));
  }
  io::GzipOrPlainFile file(path);
  std::string text;
  size_t rest = 0;  // of a line that began in the previous piece
  char line_end = '\0';
  for (bool is_end = false; !is_end;) {
    throw_if_interrupted();
    text.resize(rest + kTextAtOnce);
    const size_t count = file.read(text.data() + rest, kTextAtOnce);
    is_end = count < kTextAtOnce;
    text.resize(rest + count);
    if (line_end == '\0') {
      // Old spreadsheets end lines with CR alone.
      const bool cr_only =
          text.find('\n') == std::string::npos && text.find('\r') < text.size() - 1;
      line_end = cr_only ? '\r' : '\n';
    }
    const char* begin = text.data();
    const char* const stop = begin + text.size();
    for (const char* end = begin; (end = std::find(begin, stop, line_end)) != stop;
         begin = end + 1) {
      line(begin, end);
    }
    rest = size_t(stop - begin);
    text.erase(0, text.size() - rest);
  }
  if (rest > 0) line(text.data(), text.data() + rest);
}

/// Moves the values of a list into a tensor.
template <class T>
torch::Tensor tensor_of(std::vector<T> values, torch::ScalarType type) {
  auto* const kept = new std::vector<T>(std::move(values));
  return torch::from_blob(
      kept->data(), {int64_t(kept->size())}, [kept](void*) { delete kept; }, type);
}

bool is_letter(char c) { return std::isalpha(static_cast<unsigned char>(c)) != 0; }

/// Includes quotes, which spreadsheets put around each number.
bool separates(char c) {
  return c == ' ' || c == '\t' || c == ',' || c == ';' || c == '\r' || c == '"' || c == '\'';
}

/// 1 and 0 for the words of a polarity.
std::optional<double> polarity_word(const char* begin, const char* end) {
  const std::string word = in_small_letters({begin, std::min<size_t>(size_t(end - begin), 6)});
  if (word == "on" || word == "true") return 1;
  if (word == "off" || word == "false") return 0;
  return std::nullopt;
}

/// Number of values in one line; -1 if it contains other text, or too many values.
int parse_line(const char* begin, const char* end, Numbers& numbers) {
  int count = 0;
  while (true) {
    while (begin < end && separates(*begin)) ++begin;
    if (begin == end) return count;
    if (count == kMostColumns) return -1;
    if (*begin == '+') ++begin;
    auto [next, error] = std::from_chars(begin, end, numbers[size_t(count)]);
    if (error != std::errc() || (next < end && !separates(*next))) {
      next = std::find_if(begin, end, separates);
      const std::optional<double> sign = polarity_word(begin, next);
      if (!sign) return -1;
      numbers[size_t(count)] = *sign;
    }
    begin = next;
    ++count;
  }
}

/// Replaces decimal commas by points, as in "0,25;3;4;1": semicolons or tabs separate four numbers,
/// and a comma is between two digits. No value for other lines.
std::optional<std::string> with_points(const char* begin, const char* end) {
  const bool parted = std::count(begin, end, ';') >= 3 || std::count(begin, end, '\t') >= 3;
  if (!parted || std::find(begin, end, ',') == end || std::find(begin, end, '.') != end)
    return std::nullopt;
  std::string out(begin, end);
  const auto digit = [&](size_t i) { return i < out.size() && out[i] >= '0' && out[i] <= '9'; };
  for (size_t i = 0; i < out.size(); ++i) {
    if (out[i] != ',') continue;
    if (i == 0 || !digit(i - 1) || !digit(i + 1)) return std::nullopt;
    out[i] = '.';
  }
  return out;
}

/// Splits a line at commas, semicolons or tabs if it has any, else at blanks; a unit in brackets
/// belongs to the name before it. A table's index column has an empty name.
std::vector<std::string> words_of_line(const std::string& line) {
  char between = ' ';
  for (const char c : {';', ',', '\t'}) {
    if (line.find(c) != std::string::npos) between = c;
  }
  std::vector<std::string> out;
  std::string word;
  const auto take = [&] {
    if (between == ' ' && !out.empty() && (word[0] == '[' || word[0] == '(')) {
      out.back() += word;
    } else {
      out.push_back(word);
    }
    word.clear();
  };
  for (const char c : line) {
    if (c == '\r') continue;
    if (c != between) {
      word += c;
    } else if (between != ' ' || !word.empty()) {
      take();
    }
  }
  if (!word.empty()) take();
  return out;
}

/// Width and height in a line "346 260" or "%geometry:346,260"; no value for others.
std::optional<ImageSize> size_in(std::string line) {
  constexpr const char* kGeometry = "geometry";
  const size_t at = line.find(kGeometry);
  if (at != std::string::npos) line.erase(0, at + std::char_traits<char>::length(kGeometry));
  line.erase(0, line.find_first_not_of(" :="));
  std::replace(line.begin(), line.end(), 'x', ' ');
  Numbers numbers{};
  if (parse_line(line.data(), line.data() + line.size(), numbers) != 2) return std::nullopt;
  const auto is_side = [](double v) { return v == std::floor(v) && v > 1 && v < 65536; };
  if (!is_side(numbers[0]) || !is_side(numbers[1])) return std::nullopt;
  return ImageSize{int64_t(numbers[1]), int64_t(numbers[0])};
}

/// Converts lines to events once the columns are known.
class TextEvents {
 public:
  TextEvents(const std::filesystem::path& path, const std::optional<Columns>& known)
      : path_(path), known_(known) {}

  bool empty() const { return first_.empty() && time_.empty(); }
  /// Handles a line that is not an event: column names, the sensor's size, or a comment, which may
  /// name the columns after a colon.
  void head(const std::string& line, bool comment) {
    if (!size_) size_ = size_in(line);
    if (columns_) return;
    const size_t colon = comment ? line.rfind(':') : std::string::npos;
    const size_t begin = line.find_first_not_of("#% ", colon == std::string::npos ? 0 : colon + 1);
    if (begin == std::string::npos) return;
    std::vector<std::string> words = words_of_line(line.substr(begin));
    const auto parts = time_in_two(words);
    if (parts) words[parts->first] = "t_s", words[parts->second] = "nanoseconds";
    columns_ = named_columns(words);
    if (!columns_ && !comment && std::any_of(line.begin(), line.end(), is_letter)) {
      unknown_names_ = line.substr(0, line.find_last_not_of(" \t\r") + 1);
    }
    if (!columns_) return;
    if (parts) nanoseconds_ = parts->second;
    named_by_comment_ = comment;
    count_ = int(words.size());
    // A trailing separator adds an empty name, but not necessarily an empty number.
    fewest_ = count_;
    while (fewest_ > kColumns &&
           words[size_t(fewest_) - 1].find_first_not_of(" \t") == std::string::npos) {
      --fewest_;
    }
    unit_ = unit_in_name(words[(*columns_)[2]]);
    bool in_words = false;
    std::string read_as;
    for (size_t field = 0; field < kColumns; ++field) {
      const std::string& name = words[(*columns_)[field]];
      in_words |= event_field(name) != int(field);
      read_as += concat(field == 0 ? "" : ", ", name, " as ", kFieldNames[field]);
    }
    if (in_words) note_ = concat(path_.string(), ": columns are read by their names: ", read_as);
  }
  /// The numbers of an event.
  void add(int64_t line, int count, const Numbers& numbers) {
    if (named_by_comment_ && time_.empty() && !fits(count)) {
      // The comment was prose that contains the names by chance.
      columns_.reset();
      count_ = fewest_ = kColumns, unit_ = TimeUnit::kAuto, named_by_comment_ = false;
      nanoseconds_.reset(), note_.clear();
    }
    // v2e marks its noise in a last column, which its header does not name.
    if (!columns_ && first_.empty() && count == kColumns + 1 && is_label(numbers)) {
      count_ = fewest_ = count, has_label_ = true;
    }
    if (has_label_ && count == count_ && !is_label(numbers)) {
      throw DataError(concat(path_.string(), ":", line, ": expected 0 or 1 in a fifth column ",
                             "without a name, found ", numbers[kColumns], "; ", kNameColumns));
    }
    if (!fits(count)) {
      refuse(line, count_, count,
             !empty()             ? "complete or remove the line"
             : count_ == kColumns ? kNameColumns
                                  : "complete the line");
    }
    if (columns_) return keep(line, numbers);
    first_.push_back({numbers[0], numbers[1], numbers[2], numbers[3]});
    lines_.push_back(line);
    if (first_.size() == kLook) settle();
  }
  RawEvents take() {
    settle();
    RawEvents out;
    out.x = tensor_of(std::move(x_), torch::kFloat32);
    out.y = tensor_of(std::move(y_), torch::kFloat32);
    out.polarity = tensor_of(std::move(polarity_), torch::kInt8);
    out.time = tensor_of(std::move(time_), torch::kFloat64);
    out.unit = unit_, out.size = size_;
    out.note = note_;
    const auto is_last = [](size_t column) { return column >= kColumns; };
    if (columns_ && !nanoseconds_ && std::none_of(columns_->begin(), columns_->end(), is_last))
      out.columns = columns_;
    return out;
  }

 private:
  static constexpr size_t kLook = 4096;  // number of events sampled to recognise the columns
  static constexpr int kColumns = 4;     // columns of a list without names

  /// Whether a fifth number is 0 or 1.
  static bool is_label(const Numbers& numbers) {
    return numbers[kColumns] == 0 || numbers[kColumns] == 1;
  }
  [[noreturn]] void refuse(int64_t line, int wanted, int found, const char* mend) const {
    throw DataError(concat(path_.string(), ":", line, ": expected ", wanted,
                           " numbers (\"t x y p\" or in any order), found ", found, "; ", mend));
  }
  bool fits(int count) const { return count >= fewest_ && count <= count_; }
  void keep(int64_t line, const Numbers& numbers) {
    const double polarity = numbers[(*columns_)[3]];
    if (!(std::abs(polarity) <= 1 && polarity == std::floor(polarity))) {
      throw DataError(
          concat(path_.string(), ":", line, ": expected polarity 0/1 or -1/+1, found ", polarity));
    }
    double time = numbers[(*columns_)[2]];
    if (nanoseconds_) {
      const double rest = numbers[*nanoseconds_];
      if (!(rest >= 0 && rest < 1e9)) {
        throw DataError(concat(path_.string(), ":", line, ": expected nanoseconds from 0 to ",
                               "999999999 beside the seconds, found ", rest));
      }
      time += 1e-9 * rest;
    }
    x_.push_back(float(numbers[(*columns_)[0]]));
    y_.push_back(float(numbers[(*columns_)[1]]));
    time_.push_back(time);
    polarity_.push_back(int8_t(polarity));
  }
  void settle() {
    if (columns_) return;
    const auto is_sign = [](const Row& row) { return std::abs(row[3]) == 1 || row[3] == 0; };
    if (has_label_ && !std::all_of(first_.begin(), first_.end(), is_sign))
      refuse(lines_[0], kColumns, count_, kNameColumns);
    columns_ =
        known_ ? *known_ : likely_columns(first_, Preference::kFirst, path_.string(), kNameColumns);
    // v2e writes t x y p before its label.
    if (has_label_ && columns_ != kTimeFirst) refuse(lines_[0], kColumns, count_, kNameColumns);
    if (!unknown_names_.empty()) {
      std::array<const char*, kColumns> order{};
      for (size_t field = 0; field < order.size(); ++field) {
        order[(*columns_)[field]] = kFieldNames[field];
      }
      note_ = concat(path_.string(), ": expected a first line that names the columns x, y, t and ",
                     "p, found '", unknown_names_.substr(0, 80), "'; they are read as ", order[0],
                     ", ", order[1], ", ", order[2], ", ", order[3],
                     " by their values; correct the names if that is wrong");
    }
    if (has_label_) {
      note_ +=
          concat(note_.empty() ? path_.string() + ": " : "; ", "a fifth column of 0 and 1, as ",
                 "v2e writes for noise and signal, is not used, and all events are kept; the ",
                 "number of a camera would look the same: give each camera a file of its own");
    }
    for (size_t i = 0; i < first_.size(); ++i) {
      Numbers numbers{};
      std::copy(first_[i].begin(), first_[i].end(), numbers.begin());
      keep(lines_[i], numbers);
    }
    first_.clear(), lines_.clear();
  }

  std::filesystem::path path_;
  std::optional<Columns> known_;  ///< of lines without names; none: by their values
  std::optional<Columns> columns_;
  int count_ = kColumns;   ///< largest number of values per line
  int fewest_ = kColumns;  ///< and smallest
  bool named_by_comment_ = false;
  bool has_label_ = false;     ///< a fifth column without a name has only 0 and 1
  std::string unknown_names_;  ///< a first line of words that are no known names
  std::string note_;
  std::optional<size_t> nanoseconds_;  ///< position of the nanoseconds that are added to the
                                       ///< seconds
  TimeUnit unit_ = TimeUnit::kAuto;
  std::optional<ImageSize> size_;
  std::vector<Row> first_;      ///< buffered until the columns are known
  std::vector<int64_t> lines_;  ///< their line numbers
  std::vector<double> time_;
  std::vector<float> x_, y_;
  std::vector<int8_t> polarity_;
};

/// Skips the UTF-8 byte order mark that spreadsheets put before the first line.
/// @throws DataError for that of UTF-16.
const char* behind_mark(const std::filesystem::path& path, const char* begin, const char* end) {
  const std::string first(begin, std::min<size_t>(size_t(end - begin), 2));
  if (first == "\xFF\xFE" || first == "\xFE\xFF") {
    throw DataError(concat(path.string(), ": expected UTF-8, found text in UTF-16; ",
                           "iconv -f UTF-16 -t UTF-8 ", path.filename().string(),
                           " > events.csv makes one"));
  }
  constexpr char kMark[] = "\xEF\xBB\xBF";
  return end - begin >= 3 && std::equal(kMark, kMark + 3, begin) ? begin + 3 : begin;
}

}  // namespace

RawEvents read_text_events(const std::filesystem::path& path, const std::optional<Columns>& known) {
  TextEvents events(path, known);
  int64_t line = 0;
  bool header_seen = false;
  for_each_line(path, [&](const char* begin, const char* end) {
    if (++line == 1) begin = behind_mark(path, begin, end);
    const bool comment = begin < end && (*begin == '#' || *begin == '%');
    Numbers numbers{};
    const auto pointed = comment ? std::nullopt : with_points(begin, end);
    const int count = comment ? 0
                      : pointed
                          ? parse_line(pointed->data(), pointed->data() + pointed->size(), numbers)
                          : parse_line(begin, end, numbers);
    if (count == 0 && !comment) return;
    const std::string text(begin, end);
    // One line of column names, or of width and height, may come first.
    const bool is_head = comment || (events.empty() && !header_seen && count < 4);
    if (is_head) {
      if (events.empty()) events.head(text, comment);
      header_seen = header_seen || !comment;
      return;
    }
    if (count < 0) {
      throw DataError(concat(path.string(), ":", line, ": expected numbers (\"t x y p\"), found '",
                             text.substr(0, 40),
                             "'; remove the line or, if polarity is a word, write 1 for brighter "
                             "and 0 for darker"));
    }
    events.add(line, count, numbers);
  });
  return events.take();
}

}  // namespace jade::events
