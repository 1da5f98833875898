// SPDX-License-Identifier: Apache-2.0
// Lists in text that people write with editors and spreadsheets.
#pragma once

#include <filesystem>
#include <string>

namespace jade::io {

/// Content of a text file in UTF-8, without the byte order mark before it.
/// @throws DataError naming a file that cannot be read, a placeholder (stand_in.h), NumPy arrays, a
///   zip archive, and text in UTF-16 with or without its mark.
std::string read_text(const std::filesystem::path& path);

/// Replaces the comma of a number by a point: "-0,25" becomes "-0.25". Other text stays.
std::string with_point(std::string number);

}  // namespace jade::io
