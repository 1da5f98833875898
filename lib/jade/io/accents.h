// SPDX-License-Identifier: Apache-2.0
// File names whose accents are stored in another way: é as one letter, or as e and a mark (macOS).
#pragma once

#include <filesystem>
#include <string>

namespace jade::io {

/// Whether two names in UTF-8 are equal up to composed and decomposed letters. Hangul and letters
/// up to U+017F are compared exactly; other letters equal any base with marks.
bool same_but_accents(const std::string& a, const std::string& b);

/// The existing path that equals `path` up to composed and decomposed letters. Empty for paths in
/// ASCII, and if no path or more than one does.
std::filesystem::path respelled(const std::filesystem::path& path);

}  // namespace jade::io
