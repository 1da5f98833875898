// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "jade/sweep/memory.h"
#include "jade/sweep/output.h"
#include "jade/sweep/plan.h"

namespace jade::sweep {

struct LocalOptions {
  std::filesystem::path program;            ///< the training program
  std::vector<std::string> devices{"cpu"};  ///< "cpu" or "cuda:N"
  int jobs = 1;                             ///< runs at once at most, spread over the devices
  int cores = 1;                            ///< shared out among the runs
  bool retry_failed = false;
  int64_t memory_margin = int64_t{1} << 30;  ///< bytes that stay free
  int poll_ms = 200;
  std::function<void()> on_end;  ///< after each run, for the table
};

/// How many of `runs` go at once where nobody says: six per GPU, as long as each has a core, or one
/// per two cores where the CPU trains; never more than there are, as they share out the cores.
/// Memory may let fewer start (may_start()).
int jobs_for(const std::vector<std::string>& devices, int cores, int runs);

/// Runs what the plan lacks as child processes, several at once while memory lasts, and goes on
/// past failed ones. A request to stop is passed on to the children, which save, and waited for.
/// @throws Interrupted after that.
void run_local(const Plan& plan, const SweepOutput& output, const LocalOptions& options,
               const MemoryProbe& memory);

/// The words of --devices as devices that are there, "cpu" and "cuda:N"; auto is every GPU, else
/// the CPU. @throws ConfigError for another word, DeviceError if there is no such device.
std::vector<std::string> devices_of(const std::vector<std::string>& words);

/// Processor cores that this process may use.
int usable_cores();

}  // namespace jade::sweep
