// SPDX-License-Identifier: Apache-2.0
// Runs work in stages whose results stay on disk, so that it can be repeated, changed and
// interrupted.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace jade::import {

struct Stage {
  std::string name;      ///< also of its folder
  std::string settings;  ///< all inputs of its result besides the previous stages
  /// Writes the result into an empty folder. @return a one-line summary
  std::function<std::string(const std::filesystem::path&)> make;
  /// Reads the result for the later stages.
  std::function<void(const std::filesystem::path&)> load;
};

/// Which stages to run, by name; empty: from the first outdated one to the last.
struct StageRange {
  std::string from, until;
};

/// Runs the outdated stages: those whose settings or predecessors changed since their folder was
/// written, and all from `from` on. A result appears in FOLDER/NAME completely or not at all, so an
/// interruption loses only the running stage; later stages always read it from there. Stages after
/// a recomputed one are outdated, even if the run ends before them. Logs one line per stage with
/// its time.
/// @throws ConfigError for unknown stage names, or `until` before `from`; errors of the stages.
void run_stages(const std::filesystem::path& folder, const std::vector<Stage>& stages,
                const StageRange& range);

}  // namespace jade::import
