// SPDX-License-Identifier: Apache-2.0
#include "jade/core/freed_memory.h"

#include <limits>
#include <malloc.h>

namespace jade {

#ifdef __GLIBC__
namespace {

/// Values that glibc's dynamic thresholds reach in a program with large blocks (mallopt(3)).
constexpr int kMmapBytes = 32 << 20, kTrimBytes = 2 * kMmapBytes;

void trim_beyond(int bytes) {
  mallopt(M_MMAP_THRESHOLD, kMmapBytes);
  mallopt(M_TRIM_THRESHOLD, bytes);
}

}  // namespace

FreedMemoryKept::FreedMemoryKept() { trim_beyond(std::numeric_limits<int>::max()); }

FreedMemoryKept::~FreedMemoryKept() {
  trim_beyond(kTrimBytes);
  malloc_trim(0);
}
#else
FreedMemoryKept::FreedMemoryKept() = default;
FreedMemoryKept::~FreedMemoryKept() = default;
#endif

}  // namespace jade
