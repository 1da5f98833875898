// SPDX-License-Identifier: Apache-2.0
#include "jade/sweep/memory.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <sstream>

#include "jade/core/error.h"

namespace jade::sweep {
namespace {

/// Parses "Name:   1234 kB" of a /proc file, in bytes; -1 without it.
int64_t proc_bytes(const std::string& file, const std::string& name) {
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    if (line.rfind(name + ":", 0) == 0) return 1024 * std::atoll(line.c_str() + name.size() + 1);
  }
  return -1;
}

/// Reads a control group file with one number; -1 for "max" or if missing.
int64_t group_bytes(const std::string& name) {
  std::ifstream in("/sys/fs/cgroup/" + name);
  int64_t value = -1;
  return in >> value ? value : -1;
}

int64_t group_cache_bytes() {
  std::ifstream in("/sys/fs/cgroup/memory.stat");
  std::string name;
  for (int64_t value = 0; in >> name >> value;) {
    if (name == "inactive_file") return value;
  }
  return 0;
}

int64_t host_free() {
  int64_t free = proc_bytes("/proc/meminfo", "MemAvailable");
  const int64_t limit = group_bytes("memory.max"), used = group_bytes("memory.current");
  if (limit > 0 && used > 0) free = std::min(free, limit - used + group_cache_bytes());
  return free;
}

/// nvidia-smi's name of cuda:N: CUDA_VISIBLE_DEVICES renumbers.
std::string smi_name(const std::string& device) {
  const size_t colon = device.find(':');
  const int index = colon == std::string::npos ? 0 : std::atoi(device.c_str() + colon + 1);
  const char* visible = std::getenv("CUDA_VISIBLE_DEVICES");
  if (visible == nullptr || *visible == 0) return concat(index);
  std::istringstream in(visible);
  std::string entry;
  for (int i = 0; std::getline(in, entry, ','); ++i) {
    if (i == index) return entry;
  }
  return concat(index);
}

/// Output of nvidia-smi for a query about the device; empty if it cannot be run.
std::string ask_smi(const std::string& device, const std::string& query) {
  const std::string name = smi_name(device);
  // The name is passed to a shell.
  if (name.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-/") !=
      std::string::npos) {
    return "";
  }
  const std::string command =
      concat("nvidia-smi -i ", name, " ", query, " --format=csv,noheader,nounits 2>/dev/null");
  const std::unique_ptr<FILE, int (*)(FILE*)> pipe(popen(command.c_str(), "r"), pclose);
  std::string answer;
  char part[256] = "";
  while (pipe && std::fgets(part, sizeof part, pipe.get()) != nullptr) answer += part;
  return answer;
}

int64_t device_free(const std::string& device) {
  const long long mib = std::atoll(ask_smi(device, "--query-gpu=memory.free").c_str());
  return mib > 0 ? int64_t{mib} << 20 : -1;
}

std::map<pid_t, int64_t> device_used(const std::string& device) {
  return read_processes(ask_smi(device, "--query-compute-apps=pid,used_memory"));
}

}  // namespace

std::map<pid_t, int64_t> read_processes(const std::string& lines) {
  std::map<pid_t, int64_t> processes;
  std::istringstream in(lines);
  for (std::string line; std::getline(in, line);) {
    long long pid = 0, mib = 0;
    if (std::sscanf(line.c_str(), "%lld, %lld", &pid, &mib) == 2 && pid > 0 && mib > 0) {
      processes[static_cast<pid_t>(pid)] += int64_t{mib} << 20;
    }
  }
  return processes;
}

MemoryProbe machine_memory() {
  return {host_free,
          [](pid_t pid) {
            return std::max<int64_t>(0, proc_bytes(concat("/proc/", pid, "/status"), "VmRSS"));
          },
          device_free, device_used};
}

bool may_start(const MemoryUse& use, int64_t margin) {
  if (use.peak <= 0) return use.running.empty();
  int64_t needed = use.peak + margin;
  for (const int64_t now : use.running) needed += std::max<int64_t>(0, use.peak - now);
  return use.free >= needed;
}

}  // namespace jade::sweep
