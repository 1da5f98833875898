// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "jade/splat/cpu/kernels.h"

namespace jade::splat::cpu {

/// The kernels for this machine, or those chosen below.
const KernelSet& kernels();

/// Names of the sets that this build has and this machine can run: "portable", "avx2", "avx512".
std::vector<std::string> available_kernels();

/// Tests and benchmarks only: uses one of available_kernels() from now on; "" goes back to the
/// best.
/// @throws DeviceError for any other.
void select_kernels(const std::string& name);

/// Tiles are 2^tile_shift() pixels wide and high: kDefaultTileShift unless a test or benchmark
/// chose otherwise (0 to kMaxTileShift).
int tile_shift();
void set_tile_shift(int shift);
constexpr int kDefaultTileShift = 5, kMaxTileShift = 5;

}  // namespace jade::splat::cpu
