// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>

namespace jade::splat::cpu {

/// Runs task(0) … task(count − 1) on torch's threads, each thread taking the next remaining one.
/// Tasks must be independent. Serial inside another parallel region.
void parallel_tasks(int64_t count, const std::function<void(int64_t)>& task);

}  // namespace jade::splat::cpu
