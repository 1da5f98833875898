// SPDX-License-Identifier: Apache-2.0
// Selects among kernels that are compiled for several instruction sets. Kernel sources include this
// header, so it must contain no library code.
#pragma once

namespace jade::kernel {

/// Each set includes the ones before it. Avx2 is x86-64 with AVX2, FMA, BMI and BMI2; avx512 adds
/// F, DQ, VL and BW.
enum class Isa { kPortable, kAvx2, kAvx512 };
constexpr Isa kIsas[] = {Isa::kPortable, Isa::kAvx2, Isa::kAvx512};

/// "portable", "avx2" or "avx512".
const char* name(Isa isa);

/// Whether this build contains the set and this machine supports it.
bool can_run(Isa isa);

/// Instruction set of the ops: the best that can_run(), unless a ForcedIsa exists.
Isa chosen_isa();

/// For tests and benchmarks: while an instance exists, all ops of the process use the kernels of
/// this set, or of the next lower set that they have. The destructor restores the previous set, so
/// instances must be destroyed in reverse order of construction.
class ForcedIsa {
 public:
  /// @throws DeviceError for a set that this machine or this build cannot run.
  explicit ForcedIsa(Isa isa);
  ~ForcedIsa();
  ForcedIsa(const ForcedIsa&) = delete;
  ForcedIsa& operator=(const ForcedIsa&) = delete;

 private:
  Isa before_;
};

/// An op's kernels for float and double.
template <template <class> class Kernels>
struct KernelSet {
  Kernels<float> single;
  Kernels<double> precise;

  template <class T>
  const Kernels<T>& of() const {
    if constexpr (sizeof(T) == sizeof(float)) {
      return single;
    } else {
      return precise;
    }
  }
};

/// An op's kernels, one entry per instruction set; null if it has none for that set.
template <class Set>
struct IsaTable {
  const Set* portable = nullptr;
  const Set* avx2 = nullptr;
  const Set* avx512 = nullptr;

  const Set& chosen() const {
    const Isa isa = chosen_isa();
    if (isa >= Isa::kAvx512 && avx512 != nullptr) return *avx512;
    if (isa >= Isa::kAvx2 && avx2 != nullptr) return *avx2;
    return *portable;
  }
};

}  // namespace jade::kernel
