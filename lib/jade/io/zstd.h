// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

namespace jade::io {

/// The bytes as one Zstandard frame (RFC 8878), at the library's usual level.
/// @throws DataError if the library fails.
std::string zstd(std::string_view content);

/// The content of one Zstandard frame. Memory follows what is really there, up to `size`.
/// @param size  bytes that the content must have
/// @param name  stands for the file in messages
/// @throws DataError for damaged bytes, and for content of another size.
std::string unzstd(std::string_view bytes, size_t size, const std::string& name);

}  // namespace jade::io
