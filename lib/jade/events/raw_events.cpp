// SPDX-License-Identifier: Apache-2.0
#include "jade/events/raw_events.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <fstream>
#include <map>
#include <set>
#include <torch/types.h>
#include <vector>

#include "jade/core/error.h"
#include "jade/io/hdf5.h"
#include "jade/io/npy.h"

namespace jade::events {
namespace {

constexpr int64_t kReadLength = int64_t(1) << 22;
constexpr const char* kFieldNames[4] = {"x", "y", "t", "p"};

template <class T>
void read_in_parts(const io::Hdf5File& file, const std::string& name, torch::Tensor& out) {
  // Whole chunks at a time, so that none is decompressed twice.
  const int64_t chunk = std::max<int64_t>(file.dataset(name).chunk_length, 1);
  const int64_t step = std::max<int64_t>(chunk, kReadLength / chunk * chunk);
  T* data = out.mutable_data_ptr<T>();
  for (int64_t begin = 0; begin < out.numel(); begin += step) {
    const int64_t count = std::min(step, out.numel() - begin);
    file.read<T>(name, begin, count, data + begin);
  }
}

template <class T>
torch::Tensor read_dataset(const io::Hdf5File& file, const std::string& name, int64_t length,
                           torch::ScalarType type) {
  auto out = torch::empty({length}, type);
  read_in_parts<T>(file, name, out);
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

/// Names of x, y, t, p in one group; the group nearest to the root wins.
std::array<std::string, 4> find_fields(const io::Hdf5File& file) {
  std::map<std::pair<int64_t, std::string>, std::array<std::string, 4>> groups;
  for (const auto& dataset : file.datasets()) {
    const auto slash = dataset.name.rfind('/');
    const std::string group = slash == std::string::npos ? "" : dataset.name.substr(0, slash);
    const int field =
        event_field(slash == std::string::npos ? dataset.name : dataset.name.substr(slash + 1));
    if (field < 0) continue;
    const int64_t depth = group.empty() ? 0 : 1 + std::count(group.begin(), group.end(), '/');
    groups[{depth, group}][size_t(field)] = dataset.name;
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

/// One column of numbers → the type we keep; floats with fractions stay floats in times.
RawEvents from_columns(const std::filesystem::path& path, const torch::Tensor& x,
                       const torch::Tensor& y, const torch::Tensor& t, const torch::Tensor& p) {
  check_lengths(path, {x.numel(), y.numel(), t.numel(), p.numel()});
  const auto polarity = p.flatten();
  if (!polarity.to(torch::kInt8).eq(polarity).all().item<bool>()) {
    throw DataError(
        concat(path.string(), ": expected polarities 0/1 or -1/+1, found other numbers"));
  }
  return {x.flatten().to(torch::kFloat32).contiguous(),
          y.flatten().to(torch::kFloat32).contiguous(), polarity.to(torch::kInt8).contiguous(),
          t.flatten().to(t.is_floating_point() ? torch::kFloat64 : torch::kInt64).contiguous()};
}

RawEvents from_table(const std::filesystem::path& path, const torch::Tensor& table) {
  if (table.dim() != 2 || table.size(1) != 4) {
    throw DataError(concat(path.string(), ": expected an array [N,4] of t x y p or x y t p, found ",
                           table.dim(), " dimensions"));
  }
  const auto column = [&](int64_t i) { return table.select(1, i); };
  const bool time_first =
      table.size(0) == 0 || column(0).max().to(torch::kFloat64).item<double>() >=
                                column(2).max().to(torch::kFloat64).item<double>();
  return time_first ? from_columns(path, column(1), column(2), column(0), column(3))
                    : from_columns(path, column(0), column(1), column(2), column(3));
}

std::string read_whole(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary | std::ios::ate);
  if (!file) throw DataError(concat(path.string(), ": no such event file"));
  std::string text(size_t(file.tellg()), '\0');
  file.seekg(0);
  file.read(text.data(), std::streamsize(text.size()));
  if (!file) throw DataError(concat(path.string(), ": the file cannot be read to its end"));
  return text;
}

/// Numbers of one line; -1 when something else stands there.
int parse_line(const char* begin, const char* end, double* numbers, int most) {
  const auto separates = [](char c) {
    return c == ' ' || c == '\t' || c == ',' || c == ';' || c == '\r';
  };
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
  const auto names = find_fields(file);
  std::array<int64_t, 4> lengths{};
  for (size_t i = 0; i < 4; ++i) lengths[i] = file.length(names[i]);
  check_lengths(path, lengths);
  RawEvents out;
  out.x = read_dataset<float>(file, names[0], lengths[0], torch::kFloat32);
  out.y = read_dataset<float>(file, names[1], lengths[0], torch::kFloat32);
  out.polarity = read_dataset<int8_t>(file, names[3], lengths[0], torch::kInt8);
  if (file.dataset(names[2]).floating) {
    out.time = read_dataset<double>(file, names[2], lengths[0], torch::kFloat64);
    if (file.has("t_offset")) out.time += read_number<double>(file, "t_offset");
  } else {
    out.time = read_dataset<int64_t>(file, names[2], lengths[0], torch::kInt64);
    if (file.has("t_offset")) out.time += read_number<int64_t>(file, "t_offset");
  }
  return out;
}

RawEvents read_npz_events(const std::filesystem::path& path) {
  const io::Npz archive(path);
  std::array<std::string, 4> names;
  for (const auto& name : archive.names()) {
    if (const int field = event_field(name); field >= 0) names[size_t(field)] = name;
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
  const std::string text = read_whole(path);
  std::vector<double> time;
  std::vector<float> x, y;
  std::vector<int8_t> polarity;
  int64_t line = 0;
  bool header_seen = false;
  for (const char *begin = text.data(), *stop = begin + text.size(); begin < stop;) {
    const char* end = std::find(begin, stop, '\n');
    ++line;
    double numbers[4];
    const int count = *begin == '#' ? 0 : parse_line(begin, end, numbers, 4);
    if (count == 4) {
      if (std::abs(numbers[3]) > 1) {
        throw DataError(concat(path.string(), ":", line, ": expected polarity 0/1 or -1/+1, found ",
                               numbers[3]));
      }
      time.push_back(numbers[0]);
      x.push_back(float(numbers[1]));
      y.push_back(float(numbers[2]));
      polarity.push_back(int8_t(numbers[3]));
    } else if (count != 0) {
      // One line of column names, or of width and height, may stand first.
      if (!time.empty() || header_seen)
        throw DataError(concat(path.string(), ":", line, ": expected \"t x y p\""));
      header_seen = true;
    }
    begin = end + (end < stop ? 1 : 0);
  }
  const auto copy = [](const auto& values, torch::ScalarType type) {
    return torch::from_blob(const_cast<void*>(static_cast<const void*>(values.data())),
                            {int64_t(values.size())}, type)
        .clone();
  };
  return {copy(x, torch::kFloat32), copy(y, torch::kFloat32), copy(polarity, torch::kInt8),
          copy(time, torch::kFloat64)};
}

}  // namespace jade::events
