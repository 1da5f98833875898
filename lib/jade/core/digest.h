// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

namespace jade {

/// SHA-256 of data that arrives in pieces.
class Sha256 {
 public:
  Sha256();
  ~Sha256();
  Sha256(const Sha256&) = delete;
  Sha256& operator=(const Sha256&) = delete;

  void update(const void* data, size_t bytes);
  void update(const std::string& text) { update(text.data(), text.size()); }

  /// 64 lower-case hex digits. Call once.
  std::string hex();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// SHA-256 of a whole file. @throws DataError if it cannot be read.
std::string file_sha256(const std::filesystem::path& path);

/// Base64 with padding (RFC 4648, section 4), on one line.
std::string base64(std::string_view bytes);

}  // namespace jade
