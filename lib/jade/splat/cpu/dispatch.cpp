// SPDX-License-Identifier: Apache-2.0
#include "jade/splat/cpu/dispatch.h"

#include <atomic>

#include "jade/core/check.h"
#include "jade/core/error.h"

namespace jade::splat::cpu {

namespace {

/// Best last.
std::vector<const KernelSet*> available_sets() {
  std::vector<const KernelSet*> sets = {&kPortableKernels};
#if defined(__x86_64__)
  const bool avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") &&
                    __builtin_cpu_supports("bmi") && __builtin_cpu_supports("bmi2");
  if (avx2) sets.push_back(&kAvx2Kernels);
  if (avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
      __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw")) {
    sets.push_back(&kAvx512Kernels);
  }
#endif
  return sets;
}

std::atomic<const KernelSet*>& chosen() {
  static std::atomic<const KernelSet*> set{available_sets().back()};
  return set;
}

std::atomic<int>& chosen_tile_shift() {
  static std::atomic<int> size{kDefaultTileShift};
  return size;
}

}  // namespace

const KernelSet& kernels() { return *chosen(); }

std::vector<std::string> available_kernels() {
  std::vector<std::string> names;
  for (const KernelSet* set : available_sets()) names.emplace_back(set->single.name);
  return names;
}

void select_kernels(const std::string& name) {
  const auto sets = available_sets();
  if (name.empty()) {
    chosen() = sets.back();
    return;
  }
  for (const KernelSet* set : sets) {
    if (name == set->single.name) {
      chosen() = set;
      return;
    }
  }
  throw DeviceError(concat("this machine cannot run the splatting kernels \"", name, "\""));
}

int tile_shift() { return chosen_tile_shift(); }

void set_tile_shift(int shift) {
  JADE_CHECK(shift >= 0 && shift <= kMaxTileShift, "tile shift ", shift, " is not in [0, ",
             kMaxTileShift, "]");
  chosen_tile_shift() = shift;
}

}  // namespace jade::splat::cpu
