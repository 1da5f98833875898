// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

namespace jade::import {

/// Names, sizes and modification times of a file, or of all files below a folder: hashing a
/// recording of 10 GB would take a minute. Empty if nothing can be read.
std::string fingerprint(const std::filesystem::path& path);

}  // namespace jade::import
