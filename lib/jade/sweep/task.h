// SPDX-License-Identifier: Apache-2.0
// One attempt at one run.
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <vector>

#include "jade/core/child.h"
#include "jade/core/error.h"
#include "jade/sweep/output.h"

namespace jade::sweep {

struct TaskOptions {
  std::filesystem::path program;  ///< the training program
  std::string device = "auto";
  int threads = 0;            ///< of the CPU; 0: from the environment
  bool retry_failed = false;  ///< restart diverged runs from the beginning
};

/// True if another attempt makes sense: for new and unfinished runs, and failed ones unless they
/// diverged (exit code 5), which would happen again.
bool wants_attempt(const SweepOutput& output, const std::string& id, bool retry_failed);

/// A running attempt. Resumes from the run's newest checkpoint if there is one; otherwise removes
/// the files of the previous attempt.
class Task {
 public:
  Task(const SweepOutput& output, std::string id, const TaskOptions& options);

  /// The outcome after the run has ended; it is then also on disk.
  std::optional<Outcome> poll();
  void interrupt() { child_.interrupt(); }
  void note_device_peak(int64_t bytes);
  /// The step in the newest line of metrics.jsonl; 0 before.
  int64_t step() const;

  const std::string& id() const { return id_; }
  pid_t pid() const { return child_.pid(); }
  const std::string& device() const { return outcome_.device; }

 private:
  const SweepOutput& output_;
  std::string id_;
  Outcome outcome_;
  int64_t log_begin_ = 0;
  std::chrono::steady_clock::time_point start_;
  Child child_;
};

/// Trains one run to its end as a task of a job array; passes interrupts on.
/// @return the exit code of the training program, kDevice if a signal ended it; that of the last
///   attempt if no further one makes sense.
/// @throws ConfigError if the folder has no such run, DataError if another process trains it.
ExitCode run_task(const SweepOutput& output, const std::string& id, const TaskOptions& options);

/// One line for people: "diverged (exit 5): step 12: …".
std::string describe(const Outcome& outcome);

}  // namespace jade::sweep
