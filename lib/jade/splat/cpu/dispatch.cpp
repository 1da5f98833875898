// SPDX-License-Identifier: Apache-2.0
#include "jade/splat/cpu/dispatch.h"

#include <atomic>

#include "jade/core/error.h"

namespace jade::splat::cpu {

namespace {

constexpr kernel::IsaTable<KernelSet> kTable = {
    &portable::kKernels,
#if defined(__x86_64__)
    &avx2::kKernels,
    &avx512::kKernels,
#endif
};

std::atomic<int> current_tile_shift{kDefaultTileShift};

}  // namespace

const KernelSet& kernels() { return kTable.chosen(); }

int tile_shift() { return current_tile_shift; }

ForcedTileShift::ForcedTileShift(int shift) : before_(current_tile_shift) {
  if (shift < 0 || shift > kMaxTileShift) {
    throw ContractError(concat("tile shift ", shift, " is not in [0, ", kMaxTileShift, "]"));
  }
  current_tile_shift = shift;
}

ForcedTileShift::~ForcedTileShift() { current_tile_shift = before_; }

}  // namespace jade::splat::cpu
