// SPDX-License-Identifier: Apache-2.0
// Compiled with OpenMP (see CMakeLists.txt): without it at::parallel_for is a plain loop. The
// stable ABI's version is compiled in LibTorch.
#include "jade/splat/cpu/parallel.h"

#include <algorithm>
#include <atomic>
#ifdef JADE_STABLE_ABI
#include <torch/csrc/stable/ops.h>
#else
#include <ATen/Parallel.h>
#endif

namespace jade::splat::cpu {

#ifdef JADE_STABLE_ABI
namespace threads = torch::stable;
#else
namespace threads = at;
#endif

void parallel_tasks(int64_t count, const std::function<void(int64_t)>& task) {
  std::atomic<int64_t> next{0};
  const int64_t runners = std::min<int64_t>(count, threads::get_num_threads());
  threads::parallel_for(0, runners, 1, [&](int64_t, int64_t) {
    for (int64_t i = next.fetch_add(1); i < count; i = next.fetch_add(1)) task(i);
  });
}

}  // namespace jade::splat::cpu
