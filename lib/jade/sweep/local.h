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
  int jobs = 1;                             ///< maximum number of concurrent runs over all devices
  int cores = 1;                            ///< divided among the runs
  bool retry_failed = false;
  int64_t memory_margin = int64_t{1} << 30;  ///< bytes to leave free
  int poll_ms = 200;
  std::function<void()> on_end;  ///< called after each run, to update the table
};

/// Default number of concurrent runs: six per GPU, as long as each has a core, or one per two cores
/// if the CPU trains; never more than `runs`, because they share the cores. Memory may allow fewer
/// (may_start()).
int jobs_for(const std::vector<std::string>& devices, int cores, int runs);

/// Runs the unfinished runs of the plan as child processes, several at once as memory allows, and
/// continues after failures. An interrupt is passed on to the children, which save, and waited for.
/// @throws Interrupted after that.
void run_local(const Plan& plan, const SweepOutput& output, const LocalOptions& options,
               const MemoryProbe& memory);

/// Expands the words of --devices to existing devices, "cpu" and "cuda:N"; auto is every GPU, else
/// the CPU.
/// @throws ConfigError for another word, DeviceError if there is no such device.
std::vector<std::string> devices_of(const std::vector<std::string>& words);

/// Number of CPU cores that this process may use.
int usable_cores();

}  // namespace jade::sweep
