// SPDX-License-Identifier: Apache-2.0
#include "jade/kernel/isa.h"

#include <atomic>

#include "jade/core/error.h"

namespace jade::kernel {
namespace {

std::atomic<Isa>& current() {
  static std::atomic<Isa> isa{[] {
    Isa best = Isa::kPortable;
    for (const Isa each : kIsas) {
      if (can_run(each)) best = each;
    }
    return best;
  }()};
  return isa;
}

}  // namespace

const char* name(Isa isa) {
  constexpr const char* kNames[] = {"portable", "avx2", "avx512"};
  return kNames[static_cast<int>(isa)];
}

bool can_run(Isa isa) {
  if (isa == Isa::kPortable) return true;
#if defined(__x86_64__)
  const bool avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") &&
                    __builtin_cpu_supports("bmi") && __builtin_cpu_supports("bmi2");
  if (isa == Isa::kAvx2) return avx2;
  return avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
         __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw");
#else
  return false;
#endif
}

Isa chosen_isa() { return current(); }

ForcedIsa::ForcedIsa(Isa isa) : before_(current()) {
  if (!can_run(isa)) {
    throw DeviceError(concat("this machine cannot run ", name(isa), " kernels; take another set"));
  }
  current() = isa;
}

ForcedIsa::~ForcedIsa() { current() = before_; }

}  // namespace jade::kernel
