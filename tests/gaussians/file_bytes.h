// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace jade::test {

/// A byte of a file as a number, 0 to 255.
inline int byte_at(const std::string& content, size_t at) {
  return static_cast<unsigned char>(content[at]);
}

}  // namespace jade::test
