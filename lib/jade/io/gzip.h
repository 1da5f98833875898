// SPDX-License-Identifier: Apache-2.0
#pragma once

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

}  // namespace jade::io
