// SPDX-License-Identifier: Apache-2.0
#include "jade/core/machine_memory.h"

#include <algorithm>
#include <fstream>
#include <string>
#include <unistd.h>

namespace jade {
namespace {

namespace fs = std::filesystem;

/// The smaller of `bytes` and the number in the file; ignores "max".
double bounded(double bytes, const fs::path& file) {
  std::ifstream in(file);
  double limit = 0;
  return in >> limit && limit > 0 ? std::min(bytes, limit) : bytes;
}

/// Applies the limits of a group and of its parents.
double bounded_by_groups(double bytes, const fs::path& mount, fs::path group, const char* file) {
  while (true) {
    bytes = bounded(bytes, mount / group.relative_path() / file);
    if (!group.has_relative_path()) return bytes;
    group = group.parent_path();
  }
}

}  // namespace

double machine_memory(const fs::path& root) {
  double bytes = double(sysconf(_SC_PHYS_PAGES)) * double(sysconf(_SC_PAGE_SIZE));
  const fs::path mount = root / "sys/fs/cgroup";
  // Lines "ID:CONTROLLERS:GROUP". In a container the group's path may be the host's, while the
  // limit is at the top of the mount.
  std::ifstream lines(root / "proc/self/cgroup");
  for (std::string line; std::getline(lines, line);) {
    const size_t first = line.find(':'), second = line.find(':', first + 1);
    if (first == std::string::npos || second == std::string::npos) continue;
    const std::string controllers = "," + line.substr(first + 1, second - first - 1) + ",";
    const fs::path group = line.substr(second + 1);
    if (controllers == ",,") bytes = bounded_by_groups(bytes, mount, group, "memory.max");
    if (controllers.find(",memory,") != std::string::npos) {
      bytes = bounded_by_groups(bytes, mount / "memory", group, "memory.limit_in_bytes");
    }
  }
  return bytes;
}

}  // namespace jade
