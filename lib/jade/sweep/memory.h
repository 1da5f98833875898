// SPDX-License-Identifier: Apache-2.0
// Several runs at once, and never more memory than there is.
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
  std::function<int64_t()> host_free;                      ///< bytes for new processes
  std::function<int64_t(pid_t)> host_used;                 ///< resident bytes of a process
  std::function<int64_t(const std::string&)> device_free;  ///< bytes of "cuda:N"; -1: not known
  /// Bytes that each process holds on "cuda:N"; unknown processes are absent.
  std::function<std::map<pid_t, int64_t>(const std::string&)> device_used;
};

/// The lines "pid, MiB" of nvidia-smi, in bytes; others, such as "[N/A]", are left out.
std::map<pid_t, int64_t> read_processes(const std::string& lines);

/// This machine: MemAvailable and the control group's limit, /proc, nvidia-smi.
MemoryProbe machine_memory();

/// One pool of memory as a launcher sees it.
struct MemoryUse {
  int64_t free = 0;
  std::vector<int64_t> running;  ///< what each run in the pool holds now
  int64_t peak = 0;              ///< the most that a run has been seen to hold; 0: not known yet
};

/// True when one more run fits: what is free must hold its peak, what the running ones may still
/// grow by, and a margin. Until the first peak is known, one run at a time starts.
bool may_start(const MemoryUse& use, int64_t margin);

}  // namespace jade::sweep
