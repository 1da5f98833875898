// SPDX-License-Identifier: Apache-2.0
// Products of small matrices by one warp. Must not include torch.
#pragma once

#include <cstdint>
#if defined(__CUDACC__)
#include <cuda_fp16.h>
#endif

namespace jade::kernel {

/// Rounds two numbers to half precision (11 bits) and packs them, the first into the lower 16 bits.
__device__ __forceinline__ uint32_t to_halves(float first, float second) {
#if !defined(__CUDACC__)
  return emulated_to_halves(first, second);
#else
  const __half2 both = __floats2half2_rn(first, second);
  return *reinterpret_cast<const uint32_t*>(&both);
#endif
}

/// D += A · B by the whole warp, A 16x16, B 16x8, D 16x8. A and B are in half precision, two
/// neighbours in k per register; sums are float. With g = lane / 4 and t = lane % 4 a lane holds
///     a = A[g][2t..], A[g+8][2t..], A[g][2t+8..], A[g+8][2t+8..]
///     b = B[2t..][g], B[2t+8..][g]
///     d = D[g][2t], D[g][2t+1], D[g+8][2t], D[g+8][2t+1]
/// (PTX: mma.m16n8k16, .f16).
__device__ __forceinline__ void multiply_add_f16(float (&d)[4], const uint32_t (&a)[4],
                                                 const uint32_t (&b)[2]) {
#if !defined(__CUDACC__)
  emulated_multiply_add_f16(d, a, b);  // tests/emulated
#else
  asm("mma.sync.aligned.m16n8k16.row.col.f32.f16.f16.f32 {%0,%1,%2,%3}, {%4,%5,%6,%7}, {%8,%9}, "
      "{%0,%1,%2,%3};"
      : "+f"(d[0]), "+f"(d[1]), "+f"(d[2]), "+f"(d[3])
      : "r"(a[0]), "r"(a[1]), "r"(a[2]), "r"(a[3]), "r"(b[0]), "r"(b[1]));
#endif
}

/// D += A · B by the whole warp, A 16x8, B 8x8, D 16x8. A and B are cut to TF32 (11 bits): the
/// tensor cores ignore the lower 13 bits of a float. With g = lane / 4 and t = lane % 4 a lane
/// holds
///     a = A[g][t], A[g+8][t], A[g][t+4], A[g+8][t+4]        b = B[t][g], B[t+4][g]
///     d = D[g][2t], D[g][2t+1], D[g+8][2t], D[g+8][2t+1]
/// (PTX: mma.m16n8k8, .tf32).
__device__ __forceinline__ void multiply_add_tf32(float (&d)[4], const float (&a)[4],
                                                  const float (&b)[2]) {
#if !defined(__CUDACC__)
  emulated_multiply_add_tf32(d, a, b);  // tests/emulated
#else
  asm("mma.sync.aligned.m16n8k8.row.col.f32.tf32.tf32.f32 {%0,%1,%2,%3}, {%4,%5,%6,%7}, {%8,%9}, "
      "{%0,%1,%2,%3};"
      : "+f"(d[0]), "+f"(d[1]), "+f"(d[2]), "+f"(d[3])
      : "r"(__float_as_uint(a[0])), "r"(__float_as_uint(a[1])), "r"(__float_as_uint(a[2])),
        "r"(__float_as_uint(a[3])), "r"(__float_as_uint(b[0])), "r"(__float_as_uint(b[1])));
#endif
}

}  // namespace jade::kernel
