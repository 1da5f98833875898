// SPDX-License-Identifier: Apache-2.0
#include "jade/core/machine_memory.h"

#include "support/catch.h"

#include "support/temp_dir.h"

namespace jade {
namespace {

TEST_CASE("machine memory: the least limit of the group and of those above it counts", "[core]") {
  const test::TempDir root;
  CHECK(machine_memory(root.path()) > 1e8);
  root.write("proc/self/cgroup", "0::/user/job\n");
  root.write("sys/fs/cgroup/user/job/memory.max", "max\n");
  CHECK(machine_memory(root.path()) > 1e8);
  root.write("sys/fs/cgroup/user/memory.max", "4194304\n");
  CHECK(machine_memory(root.path()) == 4194304);
  root.write("sys/fs/cgroup/memory.max", "2097152\n");
  CHECK(machine_memory(root.path()) == 2097152);
}

TEST_CASE("machine memory: limits of version 1 lie under memory/", "[core]") {
  const test::TempDir root;
  root.write("proc/self/cgroup", "7:cpu,memory:/job\n3:pids:/job\n");
  root.write("sys/fs/cgroup/memory/job/memory.limit_in_bytes", "1048576\n");
  CHECK(machine_memory(root.path()) == 1048576);
}

}  // namespace
}  // namespace jade
