// SPDX-License-Identifier: Apache-2.0
// Work in stages whose results stay on disk, so that it can be repeated, changed and interrupted.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace jade::import {

struct Stage {
  std::string name;      ///< also of its folder
  std::string settings;  ///< all that its result depends on besides the stages before it
  /// Writes the result into an empty folder. @return one line that says what came out
  std::function<std::string(const std::filesystem::path&)> make;
  /// Reads the result for the stages behind it.
  std::function<void(const std::filesystem::path&)> load;
};

/// Which stages to run, by name; empty: from the first that is not up to date, until the last.
struct StageRange {
  std::string from, until;
};

/// Runs what is not up to date: a stage whose settings or one before it changed since its folder
/// was made, and from `from` on all. A result appears in FOLDER/NAME whole or not at all, so that
/// an interruption loses the stage that runs and no more; what a stage gives to others is always
/// read back from there. What stands behind a stage that was made anew counts as not up to date,
/// also where the run ends before it gets there. Logs a line for each stage with its time.
/// @throws ConfigError for names that are no stage, or `until` before `from`; what stages throw.
void run_stages(const std::filesystem::path& folder, const std::vector<Stage>& stages,
                const StageRange& range);

/// Whether FOLDER/NAME holds what the stages would make now.
bool is_up_to_date(const std::filesystem::path& folder, const std::vector<Stage>& stages,
                   const std::string& name);

}  // namespace jade::import
