// SPDX-License-Identifier: Apache-2.0
// The part of CUDA's language that the kernels use, for a C++ compiler. Must precede every other
// header of an emulated source.
#pragma once

#include <algorithm>
#include <c10/util/Half.h>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <type_traits>

#include "emulated/block.h"

// Renames the kernels' namespaces, because the build may also contain the real GPU versions.
#define cuda emulated_cuda
#define check_launch check_emulated_launch
namespace jade::kernel {
inline void check_emulated_launch(const char*) {}
}  // namespace jade::kernel

#define __device__
#define __global__
#define __host__
#define __forceinline__ inline
#define __noinline__
#define __grid_constant__
#define __launch_bounds__(...)
// Blocks run one after the other. The section is filled with garbage before each block: block.cpp.
#define __shared__ static __attribute__((section("emulated_shared")))
#define __align__(bytes) __attribute__((aligned(bytes)))

#define threadIdx (::jade::emulated::thread_index())
#define blockIdx (::jade::emulated::block_index())
#define blockDim (::jade::emulated::block_size())
#define gridDim (::jade::emulated::grid_size())

using dim3 = jade::emulated::Index;
struct alignas(8) float2 {
  float x, y;
};
struct alignas(16) float4 {
  float x, y, z, w;
};
struct alignas(16) double2 {
  double x, y;
};
struct alignas(16) int4 {
  int32_t x, y, z, w;
};
struct alignas(8) uint2 {
  uint32_t x, y;
};
struct alignas(16) uint4 {
  uint32_t x, y, z, w;
};
inline float2 make_float2(float x, float y) { return {x, y}; }
inline float4 make_float4(float x, float y, float z, float w) { return {x, y, z, w}; }
inline uint2 make_uint2(uint32_t x, uint32_t y) { return {x, y}; }
inline uint4 make_uint4(uint32_t x, uint32_t y, uint32_t z, uint32_t w) { return {x, y, z, w}; }

template <class A, class B>
constexpr std::common_type_t<A, B> min(A a, B b) {
  return b < a ? b : a;
}
template <class A, class B>
constexpr std::common_type_t<A, B> max(A a, B b) {
  return a < b ? b : a;
}

inline float __fmul_rn(float a, float b) { return a * b; }
inline float __fdividef(float a, float b) { return a / b; }
inline uint32_t __umulhi(uint32_t a, uint32_t b) { return uint32_t(uint64_t(a) * b >> 32); }
inline int __popc(uint32_t x) { return __builtin_popcount(x); }
inline int __ffs(uint32_t x) { return __builtin_ffs(int(x)); }
inline uint32_t __float_as_uint(float x) {
  uint32_t bits;
  std::memcpy(&bits, &x, sizeof bits);
  return bits;
}
inline float __uint_as_float(uint32_t bits) {
  float x;
  std::memcpy(&x, &bits, sizeof x);
  return x;
}
inline long long __float2ll_rn(float x) { return std::llrint(x); }
template <class T>
T __ldg(const T* at) {
  return *at;
}
template <class T>
T __ldcg(const T* at) {
  return *at;
}
inline void __threadfence() {}

template <class T, class V>
T atomicAdd(T* at, V value) {
  const T before = *at;
  *at = T(before + value);
  return before;
}
template <class T, class V>
T atomicAnd(T* at, V value) {
  const T before = *at;
  *at = T(before & value);
  return before;
}
template <class T, class V>
T atomicOr(T* at, V value) {
  const T before = *at;
  *at = T(before | value);
  return before;
}
template <class T, class V>
T atomicMin(T* at, V value) {
  const T before = *at;
  *at = std::min(before, T(value));
  return before;
}
template <class T, class V>
T atomicMax(T* at, V value) {
  const T before = *at;
  *at = std::max(before, T(value));
  return before;
}

namespace jade::emulated {

template <class T>
uint64_t to_bits(T value) {
  static_assert(sizeof(T) <= sizeof(uint64_t) && std::is_trivially_copyable_v<T>);
  uint64_t bits = 0;
  std::memcpy(&bits, &value, sizeof value);
  return bits;
}
template <class T>
T from_bits(uint64_t bits) {
  T value;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}

inline unsigned lane() {
  const Index &t = thread_index(), &size = block_size();
  return (t.x + size.x * (t.y + size.y * t.z)) % 32;
}
template <class T>
T shuffle(uint32_t mask, T value, int from) {
  const Brought all = meet_warp(Meeting::kShuffle, mask, to_bits(value));
  return from_bits<T>(all.values[from >= 0 && from < int(all.count) ? unsigned(from) : lane()]);
}
template <class Pick>
uint32_t reduce(uint32_t mask, uint32_t value, const Pick& pick) {
  const Brought all = meet_warp(Meeting::kReduce, mask, value);
  uint32_t result = value;
  for (unsigned k = 0; k < all.count; ++k) {
    if (all.were_there[k]) result = pick(result, uint32_t(all.values[k]));
  }
  return result;
}

/// Replacement for `kernel<<<grid, block, bytes, stream>>>(arguments)` (cuda_to_cpp.py).
template <class Kernel>
auto launch(const Kernel& kernel, const Index& grid, const Index& block, size_t shared_bytes = 0,
            const void* = nullptr) {
  return [=](auto... arguments) {
    run_grid(
        grid, block, [&] { kernel(arguments...); }, shared_bytes);
  };
}

}  // namespace jade::emulated

inline void __syncthreads() { jade::emulated::meet_block(0); }
inline int __syncthreads_or(int value) {
  const auto all = jade::emulated::meet_block(value != 0);
  return std::any_of(all.values, all.values + all.count, [](uint64_t v) { return v != 0; });
}
inline void __syncwarp(uint32_t mask = ~0u) {
  jade::emulated::meet_warp(jade::emulated::Meeting::kWarp, mask, 0);
}
inline uint32_t __ballot_sync(uint32_t mask, bool value) {
  const auto all = jade::emulated::meet_warp(jade::emulated::Meeting::kBallot, mask, value);
  uint32_t votes = 0;
  for (unsigned k = 0; k < all.count; ++k) votes |= uint32_t(all.values[k] != 0) << k;
  return votes;
}
inline bool __any_sync(uint32_t mask, bool value) { return __ballot_sync(mask, value) != 0; }
template <class T>
uint32_t __match_any_sync(uint32_t mask, T value) {
  const uint64_t mine = jade::emulated::to_bits(value);
  const auto all = jade::emulated::meet_warp(jade::emulated::Meeting::kMatch, mask, mine);
  uint32_t peers = 0;
  for (unsigned k = 0; k < all.count; ++k) {
    peers |= uint32_t(all.were_there[k] && all.values[k] == mine) << k;
  }
  return peers;
}
template <class T>
T __shfl_sync(uint32_t mask, T value, int from) {
  return jade::emulated::shuffle(mask, value, from & 31);
}
template <class T>
T __shfl_xor_sync(uint32_t mask, T value, int bits) {
  return jade::emulated::shuffle(mask, value, int(jade::emulated::lane()) ^ bits);
}
template <class T>
T __shfl_up_sync(uint32_t mask, T value, int by) {
  return jade::emulated::shuffle(mask, value, int(jade::emulated::lane()) - by);
}
template <class T>
T __shfl_down_sync(uint32_t mask, T value, int by) {
  return jade::emulated::shuffle(mask, value, int(jade::emulated::lane()) + by);
}
inline uint32_t __reduce_add_sync(uint32_t mask, uint32_t value) {
  return jade::emulated::reduce(mask, value, [](uint32_t a, uint32_t b) { return a + b; });
}
inline uint32_t __reduce_min_sync(uint32_t mask, uint32_t value) {
  return jade::emulated::reduce(mask, value, [](uint32_t a, uint32_t b) { return std::min(a, b); });
}
inline uint32_t __reduce_or_sync(uint32_t mask, uint32_t value) {
  return jade::emulated::reduce(mask, value, [](uint32_t a, uint32_t b) { return a | b; });
}
inline uint32_t __reduce_max_sync(uint32_t mask, uint32_t value) {
  return jade::emulated::reduce(mask, value, [](uint32_t a, uint32_t b) { return std::max(a, b); });
}

/// kernel/tensor_core.cuh. Tensor cores truncate sums instead of rounding.
inline float toward_zero(double x) {
  const float nearest = float(x);
  return std::abs(double(nearest)) > std::abs(x) ? std::nextafter(nearest, 0.f) : nearest;
}
inline uint32_t emulated_to_halves(float first, float second) {
  return c10::Half(first).x | uint32_t{c10::Half(second).x} << 16;
}
inline float2 emulated_from_halves(uint32_t both) {
  return {float(c10::Half(uint16_t(both), c10::Half::from_bits())),
          float(c10::Half(uint16_t(both >> 16), c10::Half::from_bits()))};
}
/// D += A · B of 16 x kDepth and kDepth x 8 by a warp; place(a, b, lane / 4, lane % 4, A, B) puts a
/// lane's elements into the matrices. The first lane to continue computes for all: the others are
/// waiting, so their arguments are valid.
template <unsigned kDepth, class Element, class Place>
void emulated_multiply_add(float (&d)[4], const Element (&a)[4], const Element (&b)[2],
                           const Place& place) {
  struct Lane {
    float* d;
    const Element *a, *b;
    bool done;
  } mine{d, a, b, false};
  const auto all =
      jade::emulated::meet_warp(jade::emulated::Meeting::kShuffle, ~0u, uint64_t(&mine));
  if (mine.done) return;
  float left[16][kDepth], right[kDepth][8];
  for (unsigned lane = 0; lane < 32; ++lane) {
    Lane& from = *reinterpret_cast<Lane*>(all.values[lane]);
    place(from.a, from.b, lane / 4, lane % 4, left, right);
    from.done = true;
  }
  for (unsigned lane = 0; lane < 32; ++lane) {
    float* const to = reinterpret_cast<Lane*>(all.values[lane])->d;
    for (unsigned i = 0; i < 4; ++i) {
      double sum = to[i];
      const unsigned m = lane / 4 + 8 * (i / 2), n = 2 * (lane % 4) + i % 2;
      for (unsigned k = 0; k < kDepth; ++k) sum += double(left[m][k]) * right[k][n];
      to[i] = toward_zero(sum);
    }
  }
}
inline void emulated_multiply_add_f16(float (&d)[4], const uint32_t (&a)[4],
                                      const uint32_t (&b)[2]) {
  const auto place = [](const uint32_t* from_a, const uint32_t* from_b, unsigned g, unsigned t,
                        auto& left, auto& right) {
    for (unsigned k = 0; k < 4; ++k) {
      const float2 both = emulated_from_halves(from_a[k]);
      float* const to = left[g + 8 * (k % 2)] + 2 * t + 8 * (k / 2);
      to[0] = both.x, to[1] = both.y;
    }
    for (unsigned k = 0; k < 2; ++k) {
      const float2 both = emulated_from_halves(from_b[k]);
      right[2 * t + 8 * k][g] = both.x, right[2 * t + 8 * k + 1][g] = both.y;
    }
  };
  emulated_multiply_add<16>(d, a, b, place);
}
/// The hardware ignores the lower 13 bits of the mantissa.
inline float emulated_tf32(float x) { return __uint_as_float(__float_as_uint(x) & ~0x1fffu); }
inline void emulated_multiply_add_tf32(float (&d)[4], const float (&a)[4], const float (&b)[2]) {
  const auto place = [](const float* from_a, const float* from_b, unsigned g, unsigned t,
                        auto& left, auto& right) {
    for (unsigned k = 0; k < 4; ++k) {
      left[g + 8 * (k % 2)][t + 4 * (k / 2)] = emulated_tf32(from_a[k]);
    }
    for (unsigned k = 0; k < 2; ++k) right[t + 4 * k][g] = emulated_tf32(from_b[k]);
  };
  emulated_multiply_add<8>(d, a, b, place);
}
