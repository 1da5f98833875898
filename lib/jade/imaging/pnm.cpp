// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/pnm.h"

#include <algorithm>
#include <fstream>
#include <string>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"

namespace jade::imaging {
namespace {

constexpr int64_t kLargestNumber = 65535;  // of values and sides

bool is_blank(char c) { return c == ' ' || (c >= '\t' && c <= '\r'); }
bool is_numeral(char c) { return c >= '0' && c <= '9'; }

/// The number after blanks and comments, which reach from '#' to the end of a line; advances `at`
/// past it. No value for other text and numbers above kLargestNumber.
std::optional<int64_t> pnm_number(const std::string& bytes, size_t& at) {
  while (at < bytes.size() && (is_blank(bytes[at]) || bytes[at] == '#')) {
    if (bytes[at] == '#') at = std::min(bytes.find('\n', at), bytes.size());
    if (at < bytes.size()) ++at;
  }
  if (at >= bytes.size() || !is_numeral(bytes[at])) return std::nullopt;
  int64_t number = 0;
  for (; at < bytes.size() && is_numeral(bytes[at]); ++at) {
    number = 10 * number + (bytes[at] - '0');
    if (number > kLargestNumber) return std::nullopt;
  }
  return number;
}

/// Values of one byte, or of two with the larger first.
std::vector<uint16_t> binary_values(const std::string& bytes, size_t at, size_t count, bool wide) {
  const size_t size = wide ? 2 : 1, stored = (bytes.size() - std::min(at, bytes.size())) / size;
  std::vector<uint16_t> values(std::min(count, stored));
  for (uint16_t& value : values) {
    value = uint8_t(bytes[at++]);
    if (wide) value = uint16_t(value << 8 | uint8_t(bytes[at++]));
  }
  return values;
}

std::vector<uint16_t> text_values(const std::string& bytes, size_t at, size_t count) {
  std::vector<uint16_t> values;
  values.reserve(std::min(count, bytes.size() / 2));
  while (values.size() < count) {
    const auto number = pnm_number(bytes, at);
    if (!number) break;
    values.push_back(uint16_t(*number));
  }
  return values;
}

}  // namespace

std::optional<Pnm> read_pnm(const std::filesystem::path& path) {
  char start[2] = {};
  std::ifstream(path, std::ios::binary).read(start, sizeof start);
  const char kind = start[1];
  if (start[0] != 'P' || (kind != '2' && kind != '3' && kind != '5' && kind != '6'))
    return std::nullopt;
  const std::string bytes = read_file(path);
  size_t at = 2;
  const int64_t width = pnm_number(bytes, at).value_or(0);
  const int64_t height = pnm_number(bytes, at).value_or(0);
  const int64_t white = pnm_number(bytes, at).value_or(0);
  if (width == 0 || height == 0 || white == 0) {
    throw DataError(concat(path.string(), ": expected \"P", kind, " WIDTH HEIGHT WHITE\" of whole ",
                           "numbers from 1 to ", kLargestNumber,
                           ", found another header; export the ", "image again"));
  }
  Pnm out{width, height, kind == '3' || kind == '6' ? 3 : 1, white, {}};
  const auto count = size_t(width * height * out.channels);
  // One blank ends the header of bytes.
  out.values = kind >= '5' ? binary_values(bytes, at + 1, count, white > UINT8_MAX)
                           : text_values(bytes, at, count);
  if (out.values.size() == count) return out;
  throw DataError(concat(path.string(), ": expected ", count, " values of ", width, "x", height,
                         " px, found ", out.values.size(), "; copy or export the image again"));
}

}  // namespace jade::imaging
