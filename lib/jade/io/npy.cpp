// SPDX-License-Identifier: Apache-2.0
#include "jade/io/npy.h"

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <limits>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/check.h"
#include "jade/core/error.h"
#include "jade/io/npy_format.h"
#include "jade/io/stand_in.h"

namespace jade::io {
namespace {

constexpr size_t kMagicSize = 8;  // "\x93NUMPY", major, minor
constexpr size_t kMaxHeader = 1 << 20;
constexpr size_t kMaxDimensions = 32;
constexpr int64_t kMaxExtent = int64_t{1} << 40;

/// Sequential bytes from a file or from memory; `remaining` bounds every allocation.
class ByteSource {
 public:
  ByteSource(const void* bytes, size_t size)
      : bytes_(static_cast<const char*>(bytes)), remaining_(size) {}
  ByteSource(std::ifstream* file, size_t size) : file_(file), remaining_(size) {}

  size_t remaining() const { return remaining_; }
  bool read(void* out, size_t count) {
    if (count > remaining_) return false;
    if (file_ != nullptr) {
      file_->read(static_cast<char*>(out), static_cast<std::streamsize>(count));
      if (!*file_) return false;
    } else if (count > 0) {
      std::memcpy(out, bytes_, count);
      bytes_ += count;
    }
    remaining_ -= count;
    return true;
  }

 private:
  const char* bytes_ = nullptr;
  std::ifstream* file_ = nullptr;
  size_t remaining_ = 0;
};

/// The value after `key` in the header's Python dictionary, up to the end of the text.
std::string after_key(const std::string& header, const std::string& key, const std::string& name) {
  for (const char quote : {'\'', '"'}) {
    const std::string quoted = quote + key + quote;
    const size_t at = header.find(quoted);
    if (at == std::string::npos) continue;
    const size_t colon = header.find_first_not_of(" \t", at + quoted.size());
    if (colon == std::string::npos || header[colon] != ':') break;
    const size_t value = header.find_first_not_of(" \t", colon + 1);
    if (value == std::string::npos) break;
    return header.substr(value);
  }
  throw DataError(
      concat(name, ": the .npy header has no '", key, "'; the file is damaged, write it again"));
}

NpyType parse_type(const std::string& value, const std::string& name) {
  const char quote = value[0];
  const size_t end = value.find(quote, 1);
  if ((quote != '\'' && quote != '"') || end == std::string::npos) {
    throw DataError(concat(name,
                           ": expected an array of plain numbers, found a record type; save each "
                           "field as an array of its own"));
  }
  const std::string text = value.substr(1, end - 1);
  NpyType type;
  const bool known = text.size() == 3 && std::strchr("<>|=", text[0]) != nullptr &&
                     npy_scalar(text[1], text[2], &type);
  if (!known) {
    throw DataError(concat(name, ": expected bool, integer or float values, found dtype '",
                           text.substr(0, 40), "'; save the array with a plain numeric dtype"));
  }
  type.swapped = text[0] == '>';
  return type;
}

std::vector<int64_t> parse_shape(const std::string& value, const std::string& name) {
  const auto damaged = [&] {
    return DataError(concat(name, ": the .npy header has a damaged shape; write the file again"));
  };
  if (value[0] != '(') throw damaged();
  std::vector<int64_t> shape;
  int64_t number = -1;
  for (size_t i = 1; i < value.size(); ++i) {
    const char c = value[i];
    if (c >= '0' && c <= '9') {
      number = std::max<int64_t>(number, 0) * 10 + (c - '0');
      if (number > kMaxExtent) throw damaged();
    } else if (c == ',' || c == ')') {
      if (number >= 0) shape.push_back(number);
      if (number < 0 && c == ',') throw damaged();
      number = -1;
      if (shape.size() > kMaxDimensions) throw damaged();
      if (c == ')') return shape;
    } else if (c != ' ' && c != 'L') {  // Python 2 wrote 3L
      throw damaged();
    }
  }
  throw damaged();
}

std::string read_header(ByteSource& source, const std::string& name) {
  unsigned char magic[kMagicSize];
  if (!source.read(magic, kMagicSize) || std::memcmp(magic, "\x93NUMPY", 6) != 0) {
    throw DataError(
        concat(name, ": expected a .npy array, found ",
               source.remaining() == 0 ? "an empty or very short file" : "another format",
               "; write it again with numpy.save"));
  }
  unsigned char length_bytes[4] = {0, 0, 0, 0};
  if (magic[6] < 1 || magic[6] > 3 || !source.read(length_bytes, magic[6] == 1 ? 2 : 4)) {
    throw DataError(concat(name, ": expected .npy format 1 to 3, found ", int(magic[6]),
                           "; write it again with numpy.save"));
  }
  const size_t length = length_bytes[0] | size_t{length_bytes[1]} << 8 |
                        size_t{length_bytes[2]} << 16 | size_t{length_bytes[3]} << 24;
  if (length > kMaxHeader || length > source.remaining()) {
    throw DataError(
        concat(name, ": the file ends inside its header; it is truncated, copy it again"));
  }
  std::string header(length, '\0');
  if (!source.read(header.data(), length)) throw DataError(concat(name, ": cannot be read"));
  return header;
}

/// Number of elements of `shape`, or -1 if its bytes do not match the rest of the file. An empty
/// array may have long other axes, as long as its strides do not overflow.
int64_t checked_count(const std::vector<int64_t>& shape, size_t item_size, size_t remaining) {
  const bool empty = std::find(shape.begin(), shape.end(), 0) != shape.end();
  const uint64_t most = empty ? std::numeric_limits<int64_t>::max() : remaining;
  uint64_t count = 1;
  for (const int64_t extent : shape) {
    if (static_cast<uint64_t>(extent) > most / count) return -1;
    count *= std::max<uint64_t>(static_cast<uint64_t>(extent), 1);
  }
  if (empty) return remaining == 0 ? 0 : -1;
  return count * item_size == remaining ? static_cast<int64_t>(count) : -1;
}

void swap_bytes(char* data, int64_t count, size_t item_size) {
  for (int64_t i = 0; i < count; ++i) {
    std::reverse(data + i * item_size, data + (i + 1) * item_size);
  }
}

template <class From, class To>
void widen(const char* from, int64_t count, To* to, const std::string& name) {
  for (int64_t i = 0; i < count; ++i) {
    From value;
    std::memcpy(&value, from + i * sizeof(From), sizeof(From));
    if (static_cast<uint64_t>(value) > static_cast<uint64_t>(std::numeric_limits<To>::max())) {
      throw DataError(
          concat(name, ": value ", value, " at index ", i, " is above the largest int64"));
    }
    to[i] = static_cast<To>(value);
  }
}

/// Fills `out` (one dimension) from the stored items; unsigned types are converted in small blocks
/// to avoid a second copy of the array.
void read_items(ByteSource source, const NpyType& type, torch::Tensor& out,
                const std::string& name) {
  constexpr int64_t kBlock = 1 << 16;
  const auto truncated = [&] { return DataError(concat(name, ": cannot be read to its end")); };
  char* data = static_cast<char*>(out.data_ptr());
  std::vector<char> block(type.widened ? kBlock * type.item_size : 0);
  for (int64_t begin = 0; begin < out.numel(); begin += kBlock) {
    const int64_t count = std::min(kBlock, out.numel() - begin);
    char* target = type.widened ? block.data() : data + begin * type.item_size;
    if (!source.read(target, count * type.item_size)) throw truncated();
    if (type.swapped) swap_bytes(target, count, type.item_size);
    if (!type.widened) continue;
    if (type.item_size == 2) {
      widen<uint16_t>(target, count, out.data_ptr<int32_t>() + begin, name);
    } else if (type.item_size == 4) {
      widen<uint32_t>(target, count, out.data_ptr<int64_t>() + begin, name);
    } else {
      widen<uint64_t>(target, count, out.data_ptr<int64_t>() + begin, name);
    }
  }
  if (type.dtype == torch::kBool) {  // other bit patterns in a C++ bool are undefined behaviour
    for (int64_t i = 0; i < out.numel(); ++i) data[i] = data[i] != 0;
  }
}

/// Header of an array before its type is parsed.
struct NpyHeader {
  std::string type;  ///< text from the type on
  bool fortran = false;
  std::vector<int64_t> shape;
};

NpyHeader parse_header(ByteSource& source, const std::string& name) {
  const std::string header = read_header(source, name);
  return {after_key(header, "descr", name),
          after_key(header, "fortran_order", name).compare(0, 4, "True") == 0,
          parse_shape(after_key(header, "shape", name), name)};
}

[[noreturn]] void fail_length(const NpyHeader& header, size_t item_size, size_t remaining,
                              const std::string& name) {
  throw DataError(concat(name, ": the header promises shape ", c10::IntArrayRef(header.shape),
                         " of ", item_size, "-byte values, but ", remaining,
                         " bytes follow; the file is truncated or damaged, copy it again"));
}

torch::Tensor read_plain(ByteSource& source, const NpyHeader& header, const std::string& name) {
  const NpyType type = parse_type(header.type, name);
  std::vector<int64_t> shape = header.shape;
  const int64_t count = checked_count(shape, type.item_size, source.remaining());
  if (count < 0) fail_length(header, type.item_size, source.remaining(), name);
  torch::Tensor out = torch::empty({count}, type.dtype);
  read_items(source, type, out, name);
  if (!header.fortran || shape.size() < 2) return out.reshape(shape);
  std::vector<int64_t> order(shape.size());
  for (size_t i = 0; i < order.size(); ++i) order[i] = static_cast<int64_t>(order.size() - 1 - i);
  std::reverse(shape.begin(), shape.end());
  return out.reshape(shape).permute(order).contiguous();
}

/// A field of a record, and its offset.
struct NpyField {
  std::string name;
  NpyType type;
  size_t offset = 0;
};

struct NpyRecord {
  std::vector<NpyField> fields;  ///< those that are single numbers
  size_t size = 0;
};

/// Parses a record type as numpy.save writes it: [('x', '<u2'), ('', '|V4'), …].
class RecordParser {
 public:
  RecordParser(const std::string& text, const std::string& name) : text_(text), name_(name) {}

  NpyRecord parse() {
    NpyRecord out;
    expect('[');
    while (peek() != ']') {
      expect('(');
      const std::string field = quoted();
      expect(',');
      const std::string type = quoted();
      size_t count = 1;
      bool single = true;
      if (peek() == ',') {
        expect(',');
        if (peek() == '(') count = items(), single = false;
      }
      expect(')');
      if (peek() == ',') expect(',');
      add(field, type, single, count, out);
    }
    return out;
  }

 private:
  [[noreturn]] void fail() const {
    throw DataError(concat(name_,
                           ": expected an array of numbers, or of records of numbers, found "
                           "the type ",
                           text_.substr(0, 60), "; save each field as an array of its own"));
  }
  char peek() {
    at_ = text_.find_first_not_of(" \t", at_);
    if (at_ == std::string::npos) fail();
    return text_[at_];
  }
  void expect(char c) {
    if (peek() != c) fail();
    ++at_;
  }
  std::string quoted() {
    const char quote = peek();
    const size_t end = text_.find(quote, at_ + 1);
    if ((quote != '\'' && quote != '"') || end == std::string::npos) fail();
    std::string word = text_.substr(at_ + 1, end - at_ - 1);
    at_ = end + 1;
    return word;
  }
  /// Number of items of an array within a record.
  size_t items() {
    const size_t end = text_.find(')', at_);
    if (end == std::string::npos) fail();
    uint64_t count = 1;
    for (const int64_t extent : parse_shape(text_.substr(at_, end + 1 - at_), name_)) {
      if (extent > kMaxRecord) fail();
      count = std::min<uint64_t>(count * static_cast<uint64_t>(extent), kMaxRecord);
    }
    at_ = end + 1;
    return count;
  }
  void add(const std::string& field, const std::string& type, bool single, size_t count,
           NpyRecord& out) const {
    if (type.size() < 3 || std::strchr("<>|=", type[0]) == nullptr) fail();
    NpyType known;
    const bool number = type.size() == 3 && npy_scalar(type[1], type[2], &known);
    size_t size = known.item_size;
    if (!number) {  // bytes, text or padding: only their size matters
      if (std::strchr("VSUOMmc", type[1]) == nullptr) fail();
      size = 0;
      for (size_t i = 2; i < type.size() && type[i] >= '0' && type[i] <= '9'; ++i)
        size = std::min<size_t>(size * 10 + static_cast<size_t>(type[i] - '0'), kMaxRecord);
      if (type[1] == 'U') size *= 4;
      if (type[1] == 'O') fail();
    }
    known.swapped = type[0] == '>';
    if (number && single) out.fields.push_back({field, known, out.size});
    out.size += size * count;
    if (out.size > kMaxRecord) fail();
  }

  static constexpr int64_t kMaxRecord = 1 << 20;
  const std::string& text_;
  const std::string& name_;
  size_t at_ = 0;
};

NamedTensors read_records(ByteSource& source, const NpyHeader& header, const std::string& name) {
  const NpyRecord record = RecordParser(header.type, name).parse();
  if (header.shape.size() > 1) {
    throw DataError(concat(name, ": expected records in a list, found ", header.shape.size(),
                           " dimensions; flatten the array"));
  }
  if (record.size == 0 || record.fields.empty()) {
    throw DataError(concat(name, ": expected records with fields that are numbers, found none"));
  }
  const int64_t count = checked_count(header.shape, record.size, source.remaining());
  if (count < 0) fail_length(header, record.size, source.remaining(), name);
  NamedTensors out;
  for (const NpyField& field : record.fields)
    out.emplace_back(field.name, torch::empty({count}, field.type.dtype));
  constexpr int64_t kRecords = 1 << 14;
  std::vector<char> block(static_cast<size_t>(std::min(kRecords, count)) * record.size), column;
  for (int64_t begin = 0; begin < count; begin += kRecords) {
    const int64_t rows = std::min(kRecords, count - begin);
    if (!source.read(block.data(), static_cast<size_t>(rows) * record.size))
      throw DataError(concat(name, ": cannot be read to its end"));
    for (size_t k = 0; k < record.fields.size(); ++k) {
      const NpyField& field = record.fields[k];
      const size_t size = field.type.item_size;
      column.resize(static_cast<size_t>(rows) * size);
      for (size_t i = 0; i < static_cast<size_t>(rows); ++i)
        std::memcpy(&column[i * size], &block[i * record.size + field.offset], size);
      torch::Tensor part = out[k].second.narrow(0, begin, rows);
      read_items(ByteSource(column.data(), column.size()), field.type, part, name);
    }
  }
  return out;
}

NamedTensors read_fields(ByteSource source, const std::string& name) {
  const NpyHeader header = parse_header(source, name);
  if (header.type[0] == '[') return read_records(source, header, name);
  return {{"", read_plain(source, header, name)}};
}

torch::Tensor read_source(ByteSource source, const std::string& name) {
  const NpyHeader header = parse_header(source, name);
  return read_plain(source, header, name);
}

/// Calls `read` with a source over the bytes of a file.
template <class Read>
auto with_file(const std::filesystem::path& path, const Read& read) {
  if (const std::string other = stand_in(path); !other.empty())
    throw DataError(concat(path.string(), ": expected a .npy array, found ", other));
  std::error_code error;
  const auto size = std::filesystem::file_size(path, error);
  std::ifstream file(path, std::ios::binary);
  if (error || !file)
    throw DataError(concat(path.string(), ": no such file, or it cannot be read"));
  return read(ByteSource(&file, size), path.string());
}

}  // namespace

bool npy_scalar(char kind, char size, NpyType* type) {
  struct Row {
    char kind, size;
    torch::ScalarType dtype;
    bool widened;
  };
  static const Row rows[] = {
      {'b', '1', torch::kBool, false},    {'u', '1', torch::kUInt8, false},
      {'i', '1', torch::kInt8, false},    {'i', '2', torch::kInt16, false},
      {'i', '4', torch::kInt32, false},   {'i', '8', torch::kInt64, false},
      {'u', '2', torch::kInt32, true},    {'u', '4', torch::kInt64, true},
      {'u', '8', torch::kInt64, true},    {'f', '2', torch::kFloat16, false},
      {'f', '4', torch::kFloat32, false}, {'f', '8', torch::kFloat64, false}};
  for (const Row& row : rows) {
    if (row.kind != kind || row.size != size) continue;
    *type = {row.dtype, static_cast<size_t>(size - '0'), row.widened, false};
    return true;
  }
  return false;
}

std::string npy_header(const torch::Tensor& tensor, const std::string& name) {
  static const std::pair<torch::ScalarType, const char*> names[] = {
      {torch::kBool, "|b1"},    {torch::kUInt8, "|u1"},   {torch::kInt8, "|i1"},
      {torch::kInt16, "<i2"},   {torch::kInt32, "<i4"},   {torch::kInt64, "<i8"},
      {torch::kFloat16, "<f2"}, {torch::kFloat32, "<f4"}, {torch::kFloat64, "<f8"}};
  const auto* found = std::find_if(std::begin(names), std::end(names), [&](const auto& entry) {
    return entry.first == tensor.scalar_type();
  });
  if (found == std::end(names)) {
    throw ContractError(concat(name, ": .npy cannot hold ", tensor.scalar_type()));
  }
  std::string shape;
  for (const int64_t extent : tensor.sizes()) shape += concat(extent, ", ");
  if (tensor.dim() > 1) shape.resize(shape.size() - 2);
  if (tensor.dim() == 1) shape.resize(shape.size() - 1);
  std::string header =
      concat("{'descr': '", found->second, "', 'fortran_order': False, 'shape': (", shape, "), }");
  const size_t unpadded = kMagicSize + 2 + header.size() + 1;
  header.append((64 - unpadded % 64) % 64, ' ');
  header += '\n';
  const auto length = static_cast<uint16_t>(header.size());
  std::string out("\x93NUMPY\x01\x00", kMagicSize);
  out += static_cast<char>(length & 0xff);
  out += static_cast<char>(length >> 8);
  return out + header;
}

torch::Tensor parse_npy(const void* bytes, size_t size, const std::string& name) {
  return read_source(ByteSource(bytes, size), name);
}

torch::Tensor read_npy(const std::filesystem::path& path) { return with_file(path, read_source); }

NamedTensors read_npy_fields(const std::filesystem::path& path) {
  return with_file(path, read_fields);
}

NamedTensors parse_npy_fields(const void* bytes, size_t size, const std::string& name) {
  return read_fields(ByteSource(bytes, size), name);
}

void write_npy(const std::filesystem::path& path, const torch::Tensor& tensor) {
  JADE_CHECK(tensor.defined(), "write_npy of an undefined tensor to ", path.string());
  const torch::Tensor data = tensor.detach().cpu().contiguous();
  const std::string header = npy_header(data, path.string());
  AtomicFile target(path);
  std::ofstream file(target.temporary_path(), std::ios::binary | std::ios::trunc);
  file.write(header.data(), static_cast<std::streamsize>(header.size()));
  file.write(static_cast<const char*>(data.data_ptr()),
             static_cast<std::streamsize>(data.nbytes()));
  file.close();
  if (!file) throw DataError(concat(path.string(), ": cannot be written; check the free space"));
  target.commit();
}

}  // namespace jade::io
