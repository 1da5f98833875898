// SPDX-License-Identifier: Apache-2.0
// Compiled with OpenMP (see CMakeLists.txt): without it at::parallel_for is a plain loop.
#include "jade/splat/cpu/parallel.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <atomic>

namespace jade::splat::cpu {

void parallel_tasks(int64_t count, const std::function<void(int64_t)>& task) {
  std::atomic<int64_t> next{0};
  const int64_t threads = std::min<int64_t>(count, at::get_num_threads());
  at::parallel_for(0, threads, 1, [&](int64_t, int64_t) {
    for (int64_t i = next.fetch_add(1); i < count; i = next.fetch_add(1)) task(i);
  });
}

}  // namespace jade::splat::cpu
