// SPDX-License-Identifier: Apache-2.0
// Tiles whose list did not fit into the instance buffer. The block searches all splats of the view
// for theirs, nearest first, in rounds: slow, but the result is the same, so the buffer's capacity
// affects only the speed.
#pragma once

#include "jade/splat/cuda/tile_walk.cuh"

namespace jade::splat::cuda {

constexpr int kBlendThreads = 128;
constexpr int kRound = 512;  ///< splats per round

/// A round also needs memory for kRoundKeys keys, unused between rounds.
constexpr int kRoundKeys = 2 * kRound;
struct RoundShared {
  uint32_t entries[kRound];
  int count;
};

__device__ __forceinline__ void sort_round(uint64_t* keys, int count) {
  for (int size = 2; size / 2 < count; size *= 2) {
    for (int stride = size / 2; stride > 0; stride /= 2) {
      __syncthreads();
      for (int p = threadIdx.x; p < kRound; p += kBlendThreads) {
        const int low = (p / stride) * 2 * stride + (p & (stride - 1));
        // The first step of a merge compares mirrored positions, so all orders are ascending.
        const int high =
            stride == size / 2 ? (p / stride) * size + size - 1 - (p & (stride - 1)) : low + stride;
        if (high < count && keys[low] > keys[high]) {
          const uint64_t swap = keys[low];
          keys[low] = keys[high];
          keys[high] = swap;
        }
      }
    }
  }
  __syncthreads();
}

/// Writes to s.entries the next splats after key `last`, at most kRound; returns their number and
/// advances `last`. The whole block must call it.
__device__ __noinline__ int select_round(const RenderCall& call, int view, int tile_x, int tile_y,
                                         RoundShared& s, uint64_t* keys, uint64_t* last) {
  uint64_t threshold = ~0ull;
  __syncthreads();
  if (threadIdx.x == 0) s.count = 0;
  __syncthreads();
  for (int first = 0; first < call.count; first += kBlendThreads) {
    const int index = first + threadIdx.x;
    uint64_t key = ~0ull;
    if (index < call.count) {
      const Splat splat = load_splat(call.splats + int64_t(view) * call.count + index);
      if (splat.depth > 0) {
        const uint32_t mask = TileRow(Ellipse(splat), tile_y, call).mask(tile_x);
        if (mask != 0) key = make_key(splat.depth, index, mask);
      }
    }
    if (key > *last && key < threshold) keys[atomicAdd(&s.count, 1)] = key;
    __syncthreads();
    const int found = s.count;
    __syncthreads();
    if (found > kRoundKeys - kBlendThreads) {
      sort_round(keys, found);
      threshold = keys[kRound - 1] + 1;
      if (threadIdx.x == 0) s.count = kRound;
      __syncthreads();
    }
  }
  const int found = s.count;
  sort_round(keys, found);
  const int taken = min(found, kRound);
  for (int i = threadIdx.x; i < taken; i += kBlendThreads) s.entries[i] = uint32_t(keys[i]);
  if (taken > 0) *last = keys[taken - 1];
  __syncthreads();
  return taken;
}

}  // namespace jade::splat::cuda
