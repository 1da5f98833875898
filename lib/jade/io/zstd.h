// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

namespace jade::io {

/// Compresses bytes to one Zstandard frame (RFC 8878) at the library's default level.
/// @throws DataError if the library fails.
std::string zstd(std::string_view content);

/// Decompresses one Zstandard frame. Memory grows with the actual content, up to `size`.
/// @param size  bytes that the content must have
/// @param name  of the file, for messages
/// @throws DataError for damaged bytes, and for content of another size.
std::string unzstd(std::string_view bytes, size_t size, const std::string& name);

}  // namespace jade::io
