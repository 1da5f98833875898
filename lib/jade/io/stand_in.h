// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace jade::io {

/// Recognises placeholder content of a file that was not fetched or unpacked (gzip, bzip2, xz,
/// zstd, 7-Zip, RAR, tar), and text in UTF-16, and says what to do: "an empty file; …". Empty for
/// any other content. For messages about files that cannot be read.
/// @param head  the first bytes of the file; 1 kB is enough
/// @param path  the file's name for the remedy
std::string stand_in(std::string_view head, const std::filesystem::path& path);

/// Reads the first bytes of the file itself. Names a file without read permission too. Empty if it
/// cannot be opened otherwise.
std::string stand_in(const std::filesystem::path& path);

}  // namespace jade::io
