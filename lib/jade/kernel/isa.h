// SPDX-License-Identifier: Apache-2.0
// Kernels of one op compiled for several instruction sets, of which the best that this machine can
// run is taken. The kernels themselves include this, so nothing here is library code.
#pragma once

namespace jade::kernel {

/// Each runs what those before it run. Avx2 is x86-64 with AVX2, FMA, BMI and BMI2; avx512 has F,
/// DQ, VL and BW besides.
enum class Isa { kPortable, kAvx2, kAvx512 };
constexpr Isa kIsas[] = {Isa::kPortable, Isa::kAvx2, Isa::kAvx512};

/// "portable", "avx2" or "avx512".
const char* name(Isa isa);

/// Whether this build has the set and this machine runs it.
bool can_run(Isa isa);

/// Instruction set that ops use: the best that can_run(), unless a ForcedIsa exists.
Isa chosen_isa();

/// For tests and benchmarks: as long as it lives, every op of the process takes the kernels of this
/// set (or of the next lower that it has). The one before comes back with its end, so they must end
/// in the reverse order of their beginnings.
class ForcedIsa {
 public:
  /// @throws DeviceError for a set that cannot run here.
  explicit ForcedIsa(Isa isa);
  ~ForcedIsa();
  ForcedIsa(const ForcedIsa&) = delete;
  ForcedIsa& operator=(const ForcedIsa&) = delete;

 private:
  Isa before_;
};

/// An op's kernels in both types.
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

/// An op's sets of kernels, one per instruction set; null where it has none.
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
