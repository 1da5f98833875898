// SPDX-License-Identifier: Apache-2.0
// The folder of a sweep: runs/ROW/SCENE/SEED is a run directory of the training program,
// tasks/ROW/SCENE/SEED.{yaml,json,log} its settings, its outcome and its output.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "jade/sweep/plan.h"

namespace jade::sweep {

enum class RunState { kNew, kUnfinished, kRunning, kFinished, kFailed };

/// "new", "unfinished", "running", "finished", "failed".
std::string to_string(RunState state);

/// Outcome of a run's attempts; tasks/….json.
struct Outcome {
  int attempts = 0;
  int exit_code = -1;  ///< of the last attempt; -1: still running, or ended by a signal
  int signal = 0;      ///< that ended it
  double seconds = 0;  ///< total of the attempts since the run last began afresh
  int64_t peak_host_bytes = 0, peak_device_bytes = 0;
  std::string device, host;
  std::string reason;  ///< the last line of its log, if it failed
};

class SweepOutput {
 public:
  explicit SweepOutput(std::filesystem::path folder) : folder_(std::move(folder)) {}

  const std::filesystem::path& folder() const { return folder_; }
  std::filesystem::path run_folder(const std::string& id) const { return folder_ / "runs" / id; }
  std::filesystem::path settings_file(const std::string& id) const {
    return task_file(id, ".yaml");
  }
  std::filesystem::path outcome_file(const std::string& id) const { return task_file(id, ".json"); }
  std::filesystem::path log_file(const std::string& id) const { return task_file(id, ".log"); }

  /// Compares the plan with the runs that have already started, except for those that
  /// begins_afresh().
  /// @throws ConfigError naming each key that differs (the key device may).
  /// @param resolve  reads the existing settings
  /// @param starts  false: failed runs will not begin afresh, so they are compared too
  void check_settings(const Plan& plan, const Resolver& resolve, bool starts = true) const;
  /// Writes the settings of every run of the plan; a run that begins_afresh() with other settings
  /// is new again. @throws ConfigError as check_settings().
  void write_settings(const Plan& plan, const Resolver& resolve) const;

  RunState state(const std::string& id) const;
  Outcome outcome(const std::string& id) const;
  void write_outcome(const std::string& id, const Outcome& outcome) const;

  /// Ids of all runs in the folder, of any sweep.
  std::vector<std::string> present() const;

  /// True if the run has a checkpoint to resume from.
  bool can_resume(const std::string& id) const;

  /// True if nothing of the run would remain in another attempt: it has not started, or failed
  /// without a checkpoint.
  bool begins_afresh(const std::string& id) const;

 private:
  std::filesystem::path task_file(const std::string& id, const std::string& ending) const {
    return folder_ / "tasks" / (id + ending);
  }
  std::filesystem::path folder_;
};

}  // namespace jade::sweep
