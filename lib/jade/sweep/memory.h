// SPDX-License-Identifier: Apache-2.0
// Limits concurrent runs to the available memory.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <sys/types.h>
#include <vector>

namespace jade::sweep {

/// Source of memory figures; tests inject their own.
struct MemoryProbe {
  std::function<int64_t()> host_free;                      ///< bytes available to new processes
  std::function<int64_t(pid_t)> host_used;                 ///< resident bytes of a process
  std::function<int64_t(const std::string&)> device_free;  ///< bytes of "cuda:N"; -1: unknown
  /// Bytes that each process uses on "cuda:N"; unknown processes are absent.
  std::function<std::map<pid_t, int64_t>(const std::string&)> device_used;
};

/// Parses the lines "pid, MiB" of nvidia-smi into bytes; skips others, such as "[N/A]".
std::map<pid_t, int64_t> read_processes(const std::string& lines);

/// This machine: MemAvailable and the control group's limit, /proc, nvidia-smi.
MemoryProbe machine_memory();

/// Memory of one pool, as seen by the launcher.
struct MemoryUse {
  int64_t free = 0;
  std::vector<int64_t> running;  ///< current use of each run in the pool
  int64_t peak = 0;              ///< highest observed use of a run; 0: unknown
};

/// True if one more run fits: free memory must hold its peak, the remaining growth of the running
/// ones, and a margin. Until the first peak is known, only one run at a time starts.
bool may_start(const MemoryUse& use, int64_t margin);

}  // namespace jade::sweep
