// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

namespace jade::io {

/// The bytes as a gzip file (RFC 1952), at zlib's usual level. @throws DataError if zlib fails.
std::string gzip(const std::string& content);

/// True where the bytes begin as a gzip file does.
bool is_gzip(std::string_view bytes);

/// The content of a gzip file. Memory follows what is really there.
/// @param name     stands for the file in messages
/// @param at_most  bytes to read; what comes after them is left unread
/// @throws DataError for damaged bytes.
std::string gunzip(std::string_view bytes, const std::string& name,
                   size_t at_most = std::string::npos);

}  // namespace jade::io
