// SPDX-License-Identifier: Apache-2.0
// OpenCV's storage as XML, which DV writes. Private to this folder.
#pragma once

#include <filesystem>
#include <string>

#include "jade/config/document.h"

namespace jade::import {

/// True if the text begins like XML.
bool is_xml(const std::string& text);

/// Converts elements to entries of a map, texts without elements to text, and the element "data" to
/// a list of its words. Skips attributes and comments.
/// @returns content of the root element
/// @throws DataError naming the path for text that is no such XML.
config::DocumentNode read_xml(const std::filesystem::path& path, const std::string& text);

}  // namespace jade::import
