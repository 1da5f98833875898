// SPDX-License-Identifier: Apache-2.0
// Messages for people, on stderr and in a run's train.log. info: what a user would quote; warn: the
// result is valid but needs attention; debug: per step. Numbers go to metrics.jsonl, not into
// prose.
#pragma once

#include <filesystem>
#include <string>

namespace jade {

void log_debug(const std::string& message);
void log_info(const std::string& message);
void log_warn(const std::string& message);
void log_error(const std::string& message);

/// "debug", "info", "warn", "error" or "off".
/// @throws ConfigError for any other word.
void set_log_level(const std::string& level);

/// Also appends every message, with time stamps, to `path`, until called with an empty path.
/// @throws DataError if the file cannot be opened.
void set_log_file(const std::filesystem::path& path);

}  // namespace jade
