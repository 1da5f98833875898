// SPDX-License-Identifier: Apache-2.0
// Other programs that do part of the reading. Not for use outside this folder.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace jade::recording {

/// Runs a program to its end, found on PATH, with both of its outputs in `log`. Its exit code; 127
/// where there is no such program, 128 and more where a signal ended it.
/// @throws DataError if `log` cannot be written, Interrupted after stopping it.
int run_program(const std::vector<std::string>& words, const std::filesystem::path& log);

}  // namespace jade::recording
