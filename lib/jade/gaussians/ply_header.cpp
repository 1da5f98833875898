// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/ply_header.h"

#include <algorithm>
#include <charconv>
#include <cstring>
#include <map>
#include <sstream>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/io/stand_in.h"

namespace jade::gaussians {
namespace {

namespace fs = std::filesystem;

const char* const kRenderMode = "SplatRenderMode: ";

[[noreturn]] void fail(const fs::path& path, const std::string& what) {
  throw DataError(concat(path.string(), ": ", what));
}

PlyType type_named(const std::string& word, const fs::path& path) {
  static const std::map<std::string, PlyType> kTypes = {
      {"char", PlyType::kInt8},      {"int8", PlyType::kInt8},       {"uchar", PlyType::kUint8},
      {"uint8", PlyType::kUint8},    {"short", PlyType::kInt16},     {"int16", PlyType::kInt16},
      {"ushort", PlyType::kUint16},  {"uint16", PlyType::kUint16},   {"int", PlyType::kInt32},
      {"int32", PlyType::kInt32},    {"uint", PlyType::kUint32},     {"uint32", PlyType::kUint32},
      {"float", PlyType::kFloat32},  {"float32", PlyType::kFloat32}, {"double", PlyType::kFloat64},
      {"float64", PlyType::kFloat64}};
  const auto found = kTypes.find(word);
  if (found == kTypes.end()) fail(path, concat("unknown property type '", word, "' in its header"));
  return found->second;
}

size_t size_of(PlyType type) {
  switch (type) {
    case PlyType::kInt8:
    case PlyType::kUint8:
      return 1;
    case PlyType::kInt16:
    case PlyType::kUint16:
      return 2;
    case PlyType::kFloat64:
      return 8;
    default:
      return 4;
  }
}

template <class T>
T load(const char* bytes, bool swap) {
  char buffer[sizeof(T)];
  std::memcpy(buffer, bytes, sizeof(T));
  if (swap) std::reverse(buffer, buffer + sizeof(T));
  T value;
  std::memcpy(&value, buffer, sizeof(T));
  return value;
}

double load_number(const char* bytes, PlyType type, bool swap) {
  switch (type) {
    case PlyType::kInt8:
      return load<int8_t>(bytes, swap);
    case PlyType::kUint8:
      return load<uint8_t>(bytes, swap);
    case PlyType::kInt16:
      return load<int16_t>(bytes, swap);
    case PlyType::kUint16:
      return load<uint16_t>(bytes, swap);
    case PlyType::kInt32:
      return load<int32_t>(bytes, swap);
    case PlyType::kUint32:
      return load<uint32_t>(bytes, swap);
    case PlyType::kFloat32:
      return static_cast<double>(load<float>(bytes, swap));
    case PlyType::kFloat64:
      return load<double>(bytes, swap);
  }
  return 0;
}

/// Removes one line from the front of `rest` and returns it without its line end.
std::string take_line(std::string_view& rest, const fs::path& path) {
  const size_t end = rest.substr(0, 1 << 16).find('\n');
  if (end == std::string_view::npos) fail(path, "its header has no end_header line");
  std::string line(rest.substr(0, end));
  rest.remove_prefix(end + 1);
  if (!line.empty() && line.back() == '\r') line.pop_back();
  return line;
}

PlyFormat format_named(const std::string& word, const fs::path& path) {
  if (word == "ascii") return PlyFormat::kAscii;
  if (word == "binary_little_endian") return PlyFormat::kLittleEndian;
  if (word == "binary_big_endian") return PlyFormat::kBigEndian;
  fail(path, concat("unknown .ply format '", word, "'"));
}

PlyProperty parse_property(std::istringstream& words, const fs::path& path) {
  PlyProperty property;
  std::string type;
  words >> type;
  if (type == "list") {
    std::string count_type;
    words >> count_type >> type;
    property.is_list = true;
    property.count_type = type_named(count_type, path);
  }
  property.type = type_named(type, path);
  if (!(words >> property.name)) fail(path, "a property without a name in its header");
  return property;
}

PlyHeader parse_header(std::string_view content, const fs::path& path) {
  std::string_view rest = content;
  if (rest.substr(0, 4) != "ply\n" && rest.substr(0, 5) != "ply\r\n") {
    if (const std::string other = io::stand_in(content.substr(0, 1024), path); !other.empty())
      fail(path, concat("expected a .ply file, found ", other));
    fail(path,
         "no .ply file: expected the word 'ply' in its first line; copy it again, or export the "
         "scene as .ply");
  }
  take_line(rest, path);
  PlyHeader header;
  bool has_format = false;
  while (true) {
    const std::string line = take_line(rest, path);
    std::istringstream words(line);
    std::string keyword, word;
    words >> keyword;
    if (keyword == "end_header") break;
    if (keyword == "comment") {
      header.comments.push_back(line.size() > 8 ? line.substr(8) : "");
    } else if (keyword == "format") {
      words >> word;
      header.format = format_named(word, path);
      has_format = true;
    } else if (keyword == "element") {
      PlyElement element;
      if (!(words >> element.name >> element.count) || element.count < 0) {
        fail(path, concat("bad header line '", line, "'"));
      }
      header.elements.push_back(std::move(element));
    } else if (keyword == "property") {
      if (header.elements.empty()) fail(path, "a property before the first element in its header");
      header.elements.back().properties.push_back(parse_property(words, path));
    } else if (keyword != "obj_info" && !keyword.empty()) {
      fail(path, concat("unknown header line '", line.substr(0, 60), "'"));
    }
  }
  if (!has_format) fail(path, "no format line in its header");
  header.size = content.size() - rest.size();
  return header;
}

/// Bytes per row of an element without lists.
size_t row_size(const PlyElement& element) {
  size_t size = 0;
  for (const PlyProperty& property : element.properties) size += size_of(property.type);
  return size;
}

bool has_list(const PlyElement& element) {
  return std::any_of(element.properties.begin(), element.properties.end(),
                     [](const PlyProperty& property) { return property.is_list; });
}

[[noreturn]] void fail_short(const fs::path& path, const PlyElement& element) {
  fail(path, concat("ends before the ", element.count, " '", element.name,
                    "' rows that its header promises: cut short?"));
}

/// Skips one element with lists in a binary file.
std::string_view skip_lists(std::string_view data, const PlyElement& element, bool swap,
                            const fs::path& path) {
  // Without properties its rows have no bytes, however many it claims.
  if (element.properties.empty()) return data;
  for (int64_t row = 0; row < element.count; ++row) {
    for (const PlyProperty& property : element.properties) {
      size_t size = size_of(property.type);
      if (property.is_list) {
        const size_t head = size_of(property.count_type);
        if (data.size() < head) fail_short(path, element);
        const double items = load_number(data.data(), property.count_type, swap);
        if (!(items >= 0) || items > static_cast<double>(data.size())) fail_short(path, element);
        size = head + size * static_cast<size_t>(items);
      }
      if (data.size() < size) fail_short(path, element);
      data.remove_prefix(size);
    }
  }
  return data;
}

std::string_view skip_lines(std::string_view data, const PlyElement& element,
                            const fs::path& path) {
  for (int64_t row = 0; row < element.count; ++row) {
    const size_t end = data.find('\n');
    if (end == std::string_view::npos) fail_short(path, element);
    data.remove_prefix(end + 1);
  }
  return data;
}

}  // namespace

std::string render_mode_line(bool antialiased) {
  return concat("comment ", kRenderMode, antialiased ? "mip" : "default", "\n");
}

int64_t PlyElement::find(const std::string& property) const {
  for (size_t i = 0; i < properties.size(); ++i) {
    if (properties[i].name == property) return static_cast<int64_t>(i);
  }
  return -1;
}

PlyFile::PlyFile(const fs::path& path) : path_(path), content_(read_file(path)) {
  header_ = parse_header(content_, path_);
  const auto& elements = header_.elements;
  const auto vertex = std::find_if(elements.begin(), elements.end(),
                                   [](const PlyElement& e) { return e.name == "vertex"; });
  if (vertex == elements.end())
    fail(path_, "has no 'vertex' element: no point cloud or splat file");
  vertex_ = static_cast<size_t>(vertex - elements.begin());
  if (has_list(*vertex)) fail(path_, "its vertices hold lists, which no point cloud needs");
}

bool PlyFile::says_antialiased() const {
  for (const std::string& comment : header_.comments) {
    const size_t at = comment.find(kRenderMode);
    if (at != std::string::npos) return comment.find("mip", at) != std::string::npos;
  }
  return false;
}

const PlyElement* PlyFile::element(const std::string& name) const {
  for (const PlyElement& element : header_.elements) {
    if (element.name == name) return &element;
  }
  return nullptr;
}

std::string_view PlyFile::data_of(const PlyElement& element) const {
  std::string_view data = std::string_view(content_).substr(header_.size);
  for (const PlyElement& before : header_.elements) {
    if (&before == &element) break;
    data = data_behind(before, data);
  }
  return data;
}

/// The bytes after the rows of an element at the start of `data`.
std::string_view PlyFile::data_behind(const PlyElement& element, std::string_view data) const {
  if (header_.format == PlyFormat::kAscii) return skip_lines(data, element, path_);
  if (has_list(element)) {
    return skip_lists(data, element, header_.format == PlyFormat::kBigEndian, path_);
  }
  const size_t row = row_size(element);
  if (row > 0 && static_cast<uint64_t>(element.count) > data.size() / row) {
    fail_short(path_, element);
  }
  return data.substr(row * static_cast<size_t>(element.count));
}

std::string PlyFile::trailing_warning() const {
  const PlyElement& last = header_.elements.back();
  const auto text = [&](const std::string& found) {
    return concat(path_.string(), ": expected ", last.count, " '", last.name,
                  "' rows as its header says, found ", found,
                  " more behind them, which are not read; export the file again");
  };
  const bool ascii = header_.format == PlyFormat::kAscii;
  std::string_view rest;
  try {
    rest = data_of(last);
    if (!ascii) rest = data_behind(last, rest);
  } catch (const DataError&) {
    return "";  // The file ends early, in rows that are not read.
  }
  if (!ascii) {
    const size_t row = std::max<size_t>(row_size(last), 1);
    if (has_list(last)) return rest.empty() ? "" : text(concat(rest.size(), " bytes"));
    return rest.size() < row
               ? ""
               : text(concat(rest.size(), " bytes, as of ", rest.size() / row, " rows,"));
  }
  if (has_list(last)) return "";
  // Counts numbers instead of lines, because a row may span several.
  const auto is_blank = [](char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n'; };
  int64_t numbers = 0;
  bool blank = true;
  for (const char c : rest) {
    if (blank && !is_blank(c)) ++numbers;
    blank = is_blank(c);
  }
  const auto width = static_cast<int64_t>(last.properties.size());
  const int64_t rows = width == 0 ? 0 : numbers / width - last.count;
  return rows <= 0 ? "" : text(concat(rows, rows == 1 ? " row" : " rows"));
}

torch::Tensor PlyFile::read_vertices(const std::vector<std::string>& names,
                                     torch::ScalarType type) const {
  return read(vertices(), names, type);
}

torch::Tensor PlyFile::read(const PlyElement& element, const std::vector<std::string>& names,
                            torch::ScalarType type) const {
  std::vector<int64_t> column(element.properties.size(), -1);
  for (size_t i = 0; i < names.size(); ++i) {
    const int64_t found = element.find(names[i]);
    if (found < 0) {
      fail(path_, concat("its element '", element.name, "' has no property '", names[i], "'"));
    }
    column[static_cast<size_t>(found)] = static_cast<int64_t>(i);
  }
  const std::string_view data = data_of(element);
  // Checks the claimed count against the number of bytes before allocating.
  const size_t least =
      header_.format == PlyFormat::kAscii ? 2 * element.properties.size() : row_size(element);
  if (element.count > 0 &&
      (least == 0 || static_cast<uint64_t>(element.count) > (data.size() + 1) / least)) {
    fail_short(path_, element);
  }
  torch::Tensor out = torch::empty({element.count, static_cast<int64_t>(names.size())}, type);
  if (type == torch::kFloat64) {
    decode(element, data, column, out.data_ptr<double>());
  } else {
    decode(element, data, column, out.data_ptr<float>());
  }
  return out;
}

template <class T>
void PlyFile::decode(const PlyElement& element, std::string_view data,
                     const std::vector<int64_t>& column, T* out) const {
  if (header_.format == PlyFormat::kAscii) {
    decode_ascii(element, data, column, out);
  } else {
    decode_binary(element, data, column, out);
  }
}

template <class T>
void PlyFile::decode_binary(const PlyElement& element, std::string_view data,
                            const std::vector<int64_t>& column, T* out) const {
  const size_t stride = row_size(element);
  if (static_cast<uint64_t>(element.count) * stride > data.size()) fail_short(path_, element);
  const bool swap = header_.format == PlyFormat::kBigEndian;
  const auto width = std::count_if(column.begin(), column.end(), [](int64_t c) { return c >= 0; });
  for (int64_t row = 0; row < element.count; ++row) {
    const char* bytes = data.data() + static_cast<size_t>(row) * stride;
    for (size_t i = 0; i < column.size(); ++i) {
      const PlyType type = element.properties[i].type;
      if (column[i] >= 0) {
        out[row * width + column[i]] = type == PlyType::kFloat32
                                           ? static_cast<T>(load<float>(bytes, swap))
                                           : static_cast<T>(load_number(bytes, type, swap));
      }
      bytes += size_of(type);
    }
  }
}

template <class T>
void PlyFile::decode_ascii(const PlyElement& element, std::string_view data,
                           const std::vector<int64_t>& column, T* out) const {
  const auto width = std::count_if(column.begin(), column.end(), [](int64_t c) { return c >= 0; });
  const char* at = data.data();
  const char* const end = at + data.size();
  for (int64_t row = 0; row < element.count; ++row) {
    for (const int64_t target : column) {
      while (at != end && (*at == ' ' || *at == '\n' || *at == '\t' || *at == '\r')) ++at;
      if (at == end) fail_short(path_, element);
      // from_chars() does not accept a plus sign
      if (*at == '+' && end - at > 1 && at[1] != '-') ++at;
      T value = 0;
      auto [next, problem] = std::from_chars(at, end, value);
      if (problem == std::errc::result_out_of_range) {  // 0 or infinite as a float
        double wide = 0;
        problem = std::from_chars(at, end, wide).ec;
        value = static_cast<T>(wide);
      }
      if (problem != std::errc()) {
        fail(path_,
             concat("expected a number in ", element.name, " row ", row, ", found '",
                    std::string(at, std::min<size_t>(12, static_cast<size_t>(end - at))), "'"));
      }
      if (target >= 0) out[row * width + target] = value;
      at = next;
    }
  }
}

}  // namespace jade::gaussians
