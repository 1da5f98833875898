// SPDX-License-Identifier: Apache-2.0
#include "jade/io/uri.h"

#include <cctype>

namespace jade::io {
namespace {

/// The value of a hexadecimal digit, or -1.
int digit_of(char c) {
  const auto small = std::tolower(static_cast<unsigned char>(c));
  if (small >= '0' && small <= '9') return small - '0';
  return small >= 'a' && small <= 'f' ? small - 'a' + 10 : -1;
}

}  // namespace

std::string unescaped(const std::string& path) {
  std::string plain;
  for (size_t i = 0; i < path.size(); ++i) {
    const int high = path[i] == '%' && i + 2 < path.size() ? digit_of(path[i + 1]) : -1;
    const int low = high >= 0 ? digit_of(path[i + 2]) : -1;
    if (low < 0 || 16 * high + low == 0) {
      plain += path[i];
      continue;
    }
    plain += char(16 * high + low);
    i += 2;
  }
  return plain;
}

}  // namespace jade::io
