// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "jade/splat/cpu/kernels.h"

namespace jade::splat::cpu {

/// The kernels for kernel::chosen_isa().
const KernelSet& kernels();

constexpr int kDefaultTileShift = 5, kMaxTileShift = 5;

/// Tiles are 2^tile_shift() pixels wide and high: kDefaultTileShift unless a ForcedTileShift
/// exists.
int tile_shift();

/// For tests and benchmarks: sets the tile size while an instance exists. The destructor restores
/// the previous size.
class ForcedTileShift {
 public:
  /// @param shift  0 to kMaxTileShift. @throws ContractError for any other.
  explicit ForcedTileShift(int shift);
  ~ForcedTileShift();
  ForcedTileShift(const ForcedTileShift&) = delete;
  ForcedTileShift& operator=(const ForcedTileShift&) = delete;

 private:
  int before_;
};

}  // namespace jade::splat::cpu
