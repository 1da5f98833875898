// SPDX-License-Identifier: Apache-2.0
// OpenCV's storage as XML, which DV writes. Not for use outside this folder.
#pragma once

#include <filesystem>
#include <string>

#include "jade/config/document.h"

namespace jade::import {

/// True where the text begins as XML does.
bool is_xml(const std::string& text);

/// Elements become entries of a map, texts without elements become text, and the element "data" a
/// list of the words in it. Attributes and comments are skipped.
/// @returns what is inside the root element
/// @throws DataError naming the path for text that is no such XML.
config::DocumentNode read_xml(const std::filesystem::path& path, const std::string& text);

}  // namespace jade::import
