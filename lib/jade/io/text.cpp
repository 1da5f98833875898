// SPDX-License-Identifier: Apache-2.0
#include "jade/io/text.h"

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/io/stand_in.h"

namespace jade::io {
namespace {

/// Files of arrays or archives in place of a list; empty for other content.
std::string archive_in(const std::string& head) {
  if (head.rfind("\x93NUMPY", 0) == 0)
    return "a NumPy array; write it as text, one line per entry (numpy.savetxt)";
  if (head.rfind("PK\x03\x04", 0) != 0) return "";
  if (head.find(".npy") != std::string::npos)
    return "NumPy arrays; write them as text, one line per entry (numpy.savetxt)";
  return "an archive (zip); unpack it and give the file within";
}

}  // namespace

std::string read_text(const std::filesystem::path& path) {
  std::string whole = read_file(path);
  if (whole.empty()) return whole;
  const std::string head = whole.substr(0, 1024);
  std::string other = stand_in(head, path);
  if (other.empty()) other = archive_in(head);
  // Without a byte order mark, the zeros of UTF-16 remain.
  if (other.empty() && head.find('\0') != std::string::npos)
    other = concat("bytes of 0: text in UTF-16, or no text; iconv -f UTF-16LE -t UTF-8 ",
                   path.filename().string(), " > utf8_", path.filename().string(), " converts it");
  if (other.empty()) return without_mark(whole);
  throw DataError(concat(path.string(), ": expected text in UTF-8, found ", other));
}

std::string with_point(std::string number) {
  constexpr const char* kDigits = "0123456789";
  const size_t comma = number.find(',');
  const size_t begin = number.find_first_not_of("+-");
  if (comma == std::string::npos || begin == comma || begin > 1) return number;
  const bool is_number = number.find_first_not_of(kDigits, begin) == comma &&
                         comma + 1 < number.size() &&
                         number.find_first_not_of(kDigits, comma + 1) == std::string::npos;
  if (is_number) number[comma] = '.';
  return number;
}

}  // namespace jade::io
