// SPDX-License-Identifier: Apache-2.0
#include "jade/events/raw_events.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <fstream>
#include <map>
#include <memory>
#include <optional>
#include <torch/types.h>
#include <vector>

#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/io/hdf5.h"
#include "jade/io/npy.h"

namespace jade::events {
namespace {

constexpr int64_t kReadLength = int64_t(1) << 22;
constexpr size_t kTextAtOnce = size_t(1) << 22;
constexpr const char* kFieldNames[4] = {"x", "y", "t", "p"};

template <class T>
void read_in_parts(const io::Hdf5File& file, const std::string& name, const Stretch& stretch,
                   T* data) {
  // Whole chunks at a time, so that none is decompressed twice.
  const int64_t chunk = std::max<int64_t>(file.dataset(name).chunk_length, 1);
  const int64_t step = std::max<int64_t>(chunk, kReadLength / chunk * chunk);
  for (int64_t begin = stretch.begin; begin < stretch.end;) {
    throw_if_interrupted();
    const int64_t count = std::min((begin / step + 1) * step, stretch.end) - begin;
    file.read<T>(name, begin, count, data + (begin - stretch.begin));
    begin += count;
  }
}

template <class T>
torch::Tensor read_dataset(const io::Hdf5File& file, const std::string& name,
                           const std::vector<Stretch>& stretches, torch::ScalarType type) {
  int64_t length = 0;
  for (const Stretch& stretch : stretches) length += stretch.size();
  auto out = torch::empty({length}, type);
  T* data = out.mutable_data_ptr<T>();
  for (const Stretch& stretch : stretches) {
    read_in_parts<T>(file, name, stretch, data);
    data += stretch.size();
  }
  return out;
}

/// A data set of one number, with or without axes.
template <class T>
T read_number(const io::Hdf5File& file, const std::string& name) {
  if (file.length(name) != 1) {
    throw DataError(concat(file.path().string(), ": expected one number in '", name, "', found ",
                           file.length(name)));
  }
  T number{};
  file.read<T>(name, 0, 1, &number);
  return number;
}

/// Without its group.
std::string leaf_of(const std::string& name) { return name.substr(name.rfind('/') + 1); }

/// The array of a field. One called by its letter alone comes before those that are called
/// otherwise, which may be of something else, such as the times of frames.
void take(int field, const std::string& name, std::string& taken) {
  if (leaf_of(taken) != kFieldNames[field]) taken = name;
}

/// Names of x, y, t, p in one group; the group nearest to the root wins.
std::array<std::string, 4> find_fields(const io::Hdf5File& file) {
  std::map<std::pair<int64_t, std::string>, std::array<std::string, 4>> groups;
  for (const auto& dataset : file.datasets()) {
    const auto slash = dataset.name.rfind('/');
    const std::string group = slash == std::string::npos ? "" : dataset.name.substr(0, slash);
    const int field = event_field(leaf_of(dataset.name));
    if (field < 0) continue;
    const int64_t depth = group.empty() ? 0 : 1 + std::count(group.begin(), group.end(), '/');
    take(field, dataset.name, groups[{depth, group}][size_t(field)]);
  }
  for (const auto& [group, names] : groups) {
    if (std::none_of(names.begin(), names.end(), [](const auto& name) { return name.empty(); }))
      return names;
  }
  std::string found;
  for (const auto& dataset : file.datasets()) found += (found.empty() ? "" : ", ") + dataset.name;
  throw DataError(concat(file.path().string(),
                         ": expected event arrays x, y, t and p in one group, found ",
                         found.empty() ? "no data set" : found));
}

void check_lengths(const std::filesystem::path& path, const std::array<int64_t, 4>& lengths) {
  if (std::all_of(lengths.begin(), lengths.end(), [&](int64_t n) { return n == lengths[0]; }))
    return;
  throw DataError(concat(path.string(), ": expected x, y, t and p of one length, found ",
                         lengths[0], ", ", lengths[1], ", ", lengths[2], " and ", lengths[3],
                         "; the recording is damaged or was cut short"));
}

struct Hdf5Fields {
  std::array<std::string, 4> names;  ///< of x, y, t, p
  int64_t length = 0;
};

Hdf5Fields checked_fields(const io::Hdf5File& file) {
  Hdf5Fields out{find_fields(file)};
  std::array<int64_t, 4> lengths{};
  for (size_t i = 0; i < 4; ++i) lengths[i] = file.length(out.names[i]);
  check_lengths(file.path(), lengths);
  out.length = lengths[0];
  return out;
}

/// As int8, which would cut fractions off.
torch::Tensor whole_polarity(const std::filesystem::path& path, const torch::Tensor& polarity) {
  if (!polarity.to(torch::kInt8).eq(polarity).all().item<bool>()) {
    throw DataError(
        concat(path.string(), ": expected polarities 0/1 or -1/+1, found other numbers"));
  }
  return polarity.to(torch::kInt8).contiguous();
}

RawEvents read_stretches(const io::Hdf5File& file, const Hdf5Fields& fields,
                         const std::optional<std::vector<Stretch>>& wanted) {
  const auto stretches = wanted.value_or(std::vector<Stretch>{{0, fields.length}});
  const auto& names = fields.names;
  RawEvents out;
  out.x = read_dataset<float>(file, names[0], stretches, torch::kFloat32);
  out.y = read_dataset<float>(file, names[1], stretches, torch::kFloat32);
  out.polarity = file.dataset(names[3]).floating
                     ? whole_polarity(file.path(), read_dataset<float>(file, names[3], stretches,
                                                                       torch::kFloat32))
                     : read_dataset<int8_t>(file, names[3], stretches, torch::kInt8);
  if (file.dataset(names[2]).floating) {
    out.time = read_dataset<double>(file, names[2], stretches, torch::kFloat64);
    if (file.has("t_offset")) out.time += read_number<double>(file, "t_offset");
  } else {
    out.time = read_dataset<int64_t>(file, names[2], stretches, torch::kInt64);
    if (file.has("t_offset")) out.time += read_number<int64_t>(file, "t_offset");
  }
  return out;
}

/// One column of numbers → the type we keep; floats with fractions stay floats in times.
RawEvents from_columns(const std::filesystem::path& path, const torch::Tensor& x,
                       const torch::Tensor& y, const torch::Tensor& t, const torch::Tensor& p) {
  check_lengths(path, {x.numel(), y.numel(), t.numel(), p.numel()});
  return {x.flatten().to(torch::kFloat32).contiguous(),
          y.flatten().to(torch::kFloat32).contiguous(), whole_polarity(path, p.flatten()),
          t.flatten().to(t.is_floating_point() ? torch::kFloat64 : torch::kInt64).contiguous()};
}

bool never_decreases(const torch::Tensor& column) {
  const torch::Tensor values = column.to(torch::kFloat64).contiguous();
  const double* value = values.const_data_ptr<double>();
  return std::is_sorted(value, value + values.numel());
}

/// Of x or t before y or t. Seconds are smaller than many an x, so that their order counts first.
bool is_time_first(const torch::Tensor& first, const torch::Tensor& third) {
  if (first.numel() == 0) return true;
  const bool rises = never_decreases(first);
  if (rises != never_decreases(third)) return rises;
  return first.max().to(torch::kFloat64).item<double>() >=
         third.max().to(torch::kFloat64).item<double>();
}

RawEvents from_table(const std::filesystem::path& path, const torch::Tensor& table) {
  if (table.dim() != 2 || table.size(1) != 4) {
    throw DataError(concat(path.string(), ": expected an array [N,4] of t x y p or x y t p, found ",
                           table.dim(), " dimensions"));
  }
  const auto column = [&](int64_t i) { return table.select(1, i); };
  return is_time_first(column(0), column(2))
             ? from_columns(path, column(1), column(2), column(0), column(3))
             : from_columns(path, column(0), column(1), column(2), column(3));
}

/// Calls `line` with each line of a file, of which it holds a piece at a time.
template <class Line>
void for_each_line(const std::filesystem::path& path, const Line& line) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw DataError(concat(path.string(), ": no such event file"));
  std::string text;
  size_t rest = 0;  // of a line that the piece before began
  while (file) {
    throw_if_interrupted();
    text.resize(rest + kTextAtOnce);
    file.read(text.data() + rest, std::streamsize(kTextAtOnce));
    text.resize(rest + size_t(file.gcount()));
    const char* begin = text.data();
    const char* const stop = begin + text.size();
    for (const char* end = begin; (end = std::find(begin, stop, '\n')) != stop; begin = end + 1) {
      line(begin, end);
    }
    rest = size_t(stop - begin);
    text.erase(0, text.size() - rest);
  }
  if (!file.eof()) throw DataError(concat(path.string(), ": the file cannot be read to its end"));
  if (rest > 0) line(text.data(), text.data() + rest);
}

/// The values of a list, which move into the tensor.
template <class T>
torch::Tensor tensor_of(std::vector<T> values, torch::ScalarType type) {
  auto* const kept = new std::vector<T>(std::move(values));
  return torch::from_blob(
      kept->data(), {int64_t(kept->size())}, [kept](void*) { delete kept; }, type);
}

bool separates(char c) { return c == ' ' || c == '\t' || c == ',' || c == ';' || c == '\r'; }

/// Numbers of one line; -1 when something else stands there.
int parse_line(const char* begin, const char* end, double* numbers, int most) {
  int count = 0;
  while (true) {
    while (begin < end && separates(*begin)) ++begin;
    if (begin == end) return count;
    if (count == most) return -1;
    if (*begin == '+') ++begin;
    const auto [next, error] = std::from_chars(begin, end, numbers[count]);
    if (error != std::errc() || (next < end && !separates(*next))) return -1;
    begin = next;
    ++count;
  }
}

/// Where x, y, t and p stand in a line of four numbers.
using Columns = std::array<size_t, 4>;
constexpr Columns kTimeFirst{1, 2, 0, 3}, kPlaceFirst{0, 1, 2, 3};

/// What a line of their names says, none where it is anything else.
std::optional<Columns> named_columns(const char* begin, const char* end) {
  Columns columns{};
  std::array<bool, 4> found{};
  for (size_t count = 0;; ++count) {
    while (begin < end && separates(*begin)) ++begin;
    if (begin == end) return count == 4 ? std::optional(columns) : std::nullopt;
    std::string word;
    for (; begin < end && !separates(*begin); ++begin) {
      word += char(std::tolower(static_cast<unsigned char>(*begin)));
    }
    const int field = event_field(word);
    if (field < 0 || count == 4 || found[size_t(field)]) return std::nullopt;
    found[size_t(field)] = true;
    columns[size_t(field)] = count;
  }
}

/// The order of columns that nothing names: t x y p, unless by their first events only the third
/// column can be the time. Unlike tables, lists in text begin with the time.
Columns likely_columns(const std::vector<std::array<double, 4>>& first) {
  const auto never_falls = [&](size_t column) {
    return std::is_sorted(first.begin(), first.end(),
                          [&](const auto& a, const auto& b) { return a[column] < b[column]; });
  };
  const bool third = !never_falls(0) && never_falls(2) && first.front()[2] < first.back()[2];
  return third ? kPlaceFirst : kTimeFirst;
}

/// Lines of a list in text become events once it is known which column is what.
class TextEvents {
 public:
  bool empty() const { return first_.empty() && time_.empty(); }
  bool named() const { return columns_.has_value(); }
  void name(const std::optional<Columns>& columns) { columns_ = columns; }
  /// Where a line has its polarity. Without names it is last in either order.
  size_t polarity_column() const { return columns_ ? (*columns_)[3] : kTimeFirst[3]; }

  void add(const std::array<double, 4>& numbers) {
    if (columns_) return keep(numbers);
    first_.push_back(numbers);
    if (first_.size() == kLook) settle();
  }
  RawEvents take() {
    settle();
    return {tensor_of(std::move(x_), torch::kFloat32), tensor_of(std::move(y_), torch::kFloat32),
            tensor_of(std::move(polarity_), torch::kInt8),
            tensor_of(std::move(time_), torch::kFloat64)};
  }

 private:
  static constexpr size_t kLook = 4096;  // events that tell the columns

  void keep(const std::array<double, 4>& numbers) {
    x_.push_back(float(numbers[(*columns_)[0]]));
    y_.push_back(float(numbers[(*columns_)[1]]));
    time_.push_back(numbers[(*columns_)[2]]);
    polarity_.push_back(int8_t(numbers[(*columns_)[3]]));
  }
  void settle() {
    if (columns_) return;
    columns_ = likely_columns(first_);
    for (const auto& numbers : first_) keep(numbers);
    first_.clear();
  }

  std::optional<Columns> columns_;
  std::vector<std::array<double, 4>> first_;  ///< until the columns are known
  std::vector<double> time_;
  std::vector<float> x_, y_;
  std::vector<int8_t> polarity_;
};

/// Behind the mark of UTF-8 that spreadsheets put before the first line.
const char* behind_mark(const char* begin, const char* end) {
  constexpr char kMark[] = "\xEF\xBB\xBF";
  return end - begin >= 3 && std::equal(kMark, kMark + 3, begin) ? begin + 3 : begin;
}

}  // namespace

int event_field(const std::string& name) {
  static const std::map<std::string, int> known{
      {"x", 0},   {"xs", 0},       {"y", 1},         {"ys", 1},        {"t", 2},
      {"ts", 2},  {"p", 3},        {"ps", 3},        {"timestamp", 2}, {"timestamps", 2},
      {"pol", 3}, {"polarity", 3}, {"polarities", 3}};
  const auto found = known.find(name);
  return found == known.end() ? -1 : found->second;
}

RawEvents read_hdf5_events(const std::filesystem::path& path) {
  const io::Hdf5File file(path);
  return read_stretches(file, checked_fields(file), std::nullopt);
}

RawEvents read_hdf5_events(const std::filesystem::path& path,
                           const std::vector<Stretch>& stretches) {
  const io::Hdf5File file(path);
  return read_stretches(file, checked_fields(file), stretches);
}

TimeSurvey survey_hdf5_times(const std::filesystem::path& path) {
  const auto file = std::make_shared<io::Hdf5File>(path);
  const Hdf5Fields fields = checked_fields(*file);
  const double offset = file->has("t_offset") ? read_number<double>(*file, "t_offset") : 0;
  const std::string time = fields.names[2];
  return {fields.length, [file, time, offset](int64_t begin, int64_t count, double* out) {
            read_in_parts<double>(*file, time, {begin, begin + count}, out);
            for (int64_t i = 0; i < count; ++i) out[i] += offset;
          }};
}

RawEvents read_npz_events(const std::filesystem::path& path) {
  const io::Npz archive(path);
  std::array<std::string, 4> names;
  for (const auto& name : archive.names()) {
    if (const int field = event_field(name); field >= 0) take(field, name, names[size_t(field)]);
  }
  if (std::all_of(names.begin(), names.end(), [](const auto& name) { return name.empty(); }) &&
      archive.names().size() == 1) {
    return from_table(path, archive.read(archive.names()[0]));
  }
  for (size_t i = 0; i < 4; ++i) {
    if (names[i].empty())
      throw DataError(concat(path.string(), ": expected an array named ", kFieldNames[i]));
  }
  return from_columns(path, archive.read(names[0]), archive.read(names[1]), archive.read(names[2]),
                      archive.read(names[3]));
}

RawEvents read_npy_events(const std::filesystem::path& path) {
  return from_table(path, io::read_npy(path));
}

RawEvents read_text_events(const std::filesystem::path& path) {
  TextEvents events;
  int64_t line = 0;
  bool header_seen = false;
  for_each_line(path, [&](const char* begin, const char* end) {
    if (++line == 1) begin = behind_mark(begin, end);
    const bool comment = begin < end && *begin == '#';
    std::array<double, 4> numbers{};
    const int count = comment ? 0 : parse_line(begin, end, numbers.data(), 4);
    if (count == 4) {
      const double polarity = numbers[events.polarity_column()];
      if (!(std::abs(polarity) <= 1 && polarity == std::floor(polarity))) {
        throw DataError(
            concat(path.string(), ":", line, ": expected polarity 0/1 or -1/+1, found ", polarity));
      }
      events.add(numbers);
      return;
    }
    if (comment || count != 0) {
      // One line of column names, or of width and height, may stand first.
      if (!comment && (!events.empty() || header_seen))
        throw DataError(concat(path.string(), ":", line, ": expected \"t x y p\""));
      if (events.empty() && !events.named()) events.name(named_columns(begin + comment, end));
      header_seen = header_seen || !comment;
    }
  });
  return events.take();
}

}  // namespace jade::events
