// SPDX-License-Identifier: Apache-2.0
// Converts splats to runs: a block sorts its chunk's instances by tile in shared memory, so that it
// writes whole runs, and updates a tile's counter once per chunk instead of once per splat.
#include "jade/splat/cuda/launch.h"
#include "jade/splat/cuda/tile_walk.cuh"
#include "jade/splat/cuda/warp.cuh"

namespace jade::splat::cuda {

namespace {

constexpr int kChunkThreads = 512;
constexpr int kPerThread = 12;
/// Number of instances that fit in shared memory. A larger chunk walks its tiles again instead.
constexpr int kRoom = kPerThread * kChunkThreads;
constexpr int kTilesPerThread = kMostChunkTiles / kChunkThreads;
static_assert(kTilesPerThread == 4, "a thread scans the four counters of a uint4");
static_assert(kMostChunkGaussians < 1 << kRunBits, "a run's length fits its bits");
static_assert(int64_t{kMostChunkGaussians} * kMostChunkTiles <= int64_t{1} << (32 - kRunBits),
              "a run's start fits its bits");

/// An instance in shared memory: tile << kTileShift | index in the chunk << kMaskBits | mask.
constexpr int kTileShift = 16;
static_assert(kMostChunkGaussians << kMaskBits <= 1 << kTileShift, "an index in the chunk fits");
static_assert(kMostChunkTiles <= 1 << (32 - kTileShift), "a tile fits");

struct ChunkShared {
  uint32_t instances[kRoom];
  float depth[kMostChunkGaussians];
  uint32_t warp_sum[kChunkThreads / 32];
  uint32_t count;
  unsigned long long begin;
};

/// Walks the tiles of the chunk's splats: calls expect(index in the chunk, reached tiles of its
/// next row) and visit(tile, mask) as in walk_tiles().
template <class Expect, class Visit>
__device__ __forceinline__ void walk_chunk(const RenderCall& call, int view, int first,
                                           ChunkShared& s, const Expect& expect,
                                           const Visit& visit) {
#pragma unroll 1
  for (int local = threadIdx.x; local < call.chunk_gaussians; local += kChunkThreads) {
    const int index = first + local;
    Splat splat{};
    if (index < call.count) splat = load_splat(call.splats + int64_t(view) * call.count + index);
    s.depth[local] = splat.depth;
    walk_tiles(
        splat, splat.depth > 0, call,
        [&](int owner, int tiles) { expect((local & ~31) + owner, tiles); }, visit);
  }
}

__device__ __forceinline__ uint32_t round_up_to_four(uint32_t count) { return (count + 3) & ~3u; }

__global__ void __launch_bounds__(kChunkThreads, kChunkBlocks)
    chunk_kernel(const __grid_constant__ RenderCall call) {
  extern __shared__ uint32_t cursor[];  // a tile's instances, then the position of its next one
  __shared__ ChunkShared s;
  // Neighbouring blocks process different views, so that their atomics conflict less.
  const int view = blockIdx.x % call.views, chunk = blockIdx.x / call.views;
  const int first = chunk * call.chunk_gaussians;
  const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5;
  for (int i = threadIdx.x; i < round_up_to_four(call.tiles); i += kChunkThreads) cursor[i] = 0;
  if (threadIdx.x == 0) s.count = 0;
  __syncthreads();
  uint32_t at = 0, instance = 0;
  walk_chunk(
      call, view, first, s,
      [&](int local, int tiles) {
        const Shares shares(tiles, lane);
        if (lane == 0) at = atomicAdd(&s.count, shares.total);
        at = __shfl_sync(~0u, at, 0) + shares.begin;
        instance = uint32_t(local) << kMaskBits;
      },
      [&](int tile, uint32_t mask) {
        atomicAdd(&cursor[tile], 1u);
        if (at < kRoom) s.instances[at] = uint32_t(tile) << kTileShift | instance | mask;
        ++at;
      });
  __syncthreads();

  const int count = int(s.count), first_tile = 4 * threadIdx.x;
  uint32_t counts[4] = {0, 0, 0, 0}, sum = 0;
  if (first_tile < call.tiles) {
    for (int k = 0; k < 4; ++k) {
      counts[k] = cursor[first_tile + k];
      sum += counts[k];
    }
  }
  const uint32_t scanned = inclusive_scan(sum, lane);
  if (lane == 31) s.warp_sum[warp] = scanned;
  if (threadIdx.x == 0) s.begin = atomicAdd(&call.counters->chunk_keys, (unsigned long long)count);
  __syncthreads();
  const unsigned long long begin = s.begin;
  const bool fits = begin + count <= call.capacity;
  uint32_t start = scanned - sum;
  for (int w = 0; w < warp; ++w) start += s.warp_sum[w];
  for (int k = 0; k < 4; ++k) {
    const int tile = first_tile + k;
    if (tile >= call.tiles) break;
    const int64_t global_tile = int64_t(view) * call.tiles + tile;
    call.runs[global_tile * call.chunks + chunk] = start << kRunBits | counts[k];
    if (counts[k] > 0) {
      atomicAdd(call.chunk_counts + global_tile, counts[k]);
      if (!fits) atomicOr(call.chunk_counts + global_tile, kLost);
    }
    cursor[tile] = start;
    start += counts[k];
  }
  if (threadIdx.x == 0) call.chunk_begin[view * call.chunks + chunk] = uint32_t(begin);
  if (!fits) return;
  __syncthreads();

  uint64_t* const keys = call.chunk_keys + begin;
  if (count > kRoom) {
    uint64_t key = 0;
    walk_chunk(
        call, view, first, s,
        [&](int local, int) { key = make_key(s.depth[local], first + local, 0); },
        [&](int tile, uint32_t mask) { keys[atomicAdd(&cursor[tile], 1u)] = key | mask; });
    return;
  }
  uint32_t mine[kPerThread], place[kPerThread];
#pragma unroll
  for (int k = 0; k < kPerThread; ++k) {
    const int i = k * kChunkThreads + threadIdx.x;
    if (i < count) {
      mine[k] = s.instances[i];
      place[k] = atomicAdd(&cursor[mine[k] >> kTileShift], 1u);
    }
  }
  __syncthreads();
#pragma unroll
  for (int k = 0; k < kPerThread; ++k) {
    if (k * kChunkThreads + threadIdx.x < count) s.instances[place[k]] = mine[k];
  }
  __syncthreads();
  for (int i = threadIdx.x; i < count; i += kChunkThreads) {
    const uint32_t entry = s.instances[i] & ((1u << kTileShift) - 1), local = entry >> kMaskBits;
    keys[i] = make_key(s.depth[local], first + int(local), entry & ((1u << kMaskBits) - 1));
  }
}

}  // namespace

void launch_chunks(const RenderCall& call, cudaStream_t stream) {
  if (call.count == 0) return;
  const size_t cursors = (size_t(call.tiles) + 3) / 4 * 4 * sizeof(uint32_t);
  chunk_kernel<<<call.chunks * call.views, kChunkThreads, cursors, stream>>>(call);
}

}  // namespace jade::splat::cuda
