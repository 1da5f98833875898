// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

namespace jade::io {

/// Compresses bytes to a gzip file (RFC 1952) of one member at zlib's default level, on all
/// threads. The result does not depend on their number.
/// @throws DataError if zlib fails.
std::string gzip(const std::string& content);

/// True if the bytes begin like a gzip file.
bool is_gzip(std::string_view bytes);

/// Decompresses a gzip file. Memory grows with the actual content.
/// @param name     of the file, for messages
/// @param at_most  stops after this many bytes
/// @throws DataError for damaged bytes.
std::string gunzip(std::string_view bytes, const std::string& name,
                   size_t at_most = std::string::npos);

/// A file read in pieces from its start; one that gzip compressed is decompressed on the way.
class GzipOrPlainFile {
 public:
  /// @throws DataError if the file cannot be opened.
  explicit GzipOrPlainFile(const std::filesystem::path& path);

  /// Reads the next bytes and returns their number, less than `size` only at the end of the file.
  /// @param size  at most 2^30
  /// @throws DataError for a file that is damaged, cut short or cannot be read.
  size_t read(char* out, size_t size);

 private:
  std::filesystem::path path_;
  std::shared_ptr<void> file_;
};

}  // namespace jade::io
