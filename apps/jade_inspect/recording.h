// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

#include "jade/recording/recording.h"

namespace jade::apps {

/// Reads a recording and prints its content, its problems, and the next command.
/// @param import_program  the command of jade_import
/// @param options  the unit of times, and which of several event streams to read
/// @throws DataError as recording::read_recording.
void inspect_recording(const std::filesystem::path& path, recording::ReadOptions options,
                       const std::string& import_program, bool json);

}  // namespace jade::apps
