// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "jade/events/event_files.h"

namespace jade::apps {

/// Reads a recording and prints what is in it, what is wrong with it, and the next command.
/// @throws DataError as recording::read_recording.
void inspect_recording(const std::filesystem::path& path, events::TimeUnit unit, bool json);

}  // namespace jade::apps
