// SPDX-License-Identifier: Apache-2.0
// Builds one depth-sorted list per tile from splats or chunks: plan, emit, sort.
#include "jade/splat/cuda/launch.h"
#include "jade/splat/cuda/tile_walk.cuh"
#include "jade/splat/cuda/warp.cuh"

namespace jade::splat::cuda {

namespace {

constexpr int kPlanThreads = 1024;  ///< one per tile

/// Class of a list by its length, four classes per octave, longest first: a float's exponent and
/// two more bits.
__device__ __forceinline__ int length_class(uint32_t count) {
  const uint32_t one = 127u << 2;
  return kListClasses - 1 - int((__float_as_uint(float(count) + 1.0f) >> 21) - one);
}
static_assert(kMaxGaussians < 1ll << (kListClasses / 4 - 1), "the longest list has a class");

/// A thread's tile, of all views.
struct PlannedTile {
  int tile;
  bool exists, lost;
  uint32_t count;  ///< of instances
  uint32_t taken;  ///< of `keys`: longer lists do not occur; clamped, a warp's sum fits 32 bits

  __device__ __forceinline__ explicit PlannedTile(const RenderCall& call) {
    tile = blockIdx.x * kPlanThreads + threadIdx.x;
    exists = tile < call.views * call.tiles;
    uint32_t found = 0;
    if (exists) found = call.chunks > 0 ? call.chunk_counts[tile] : call.tile_list[tile].count;
    lost = (found & kLost) != 0;
    count = found & ~kLost;
    taken = min(count, 1u << 24);
  }
};

/// Increments `next` for all lanes with `wanted` and returns each lane's previous count. Lanes of
/// one class use a single atomic, because most lists are of a few classes and separate atomics
/// would be serialised.
__device__ __forceinline__ uint32_t next_place(uint32_t* next, int list_class, bool wanted,
                                               int lane) {
  const uint32_t peers = __match_any_sync(~0u, wanted ? list_class : -1);
  const int leader = __ffs(peers) - 1;
  uint32_t first = 0;
  if (wanted && lane == leader) first = atomicAdd(next + list_class, uint32_t(__popc(peers)));
  first = __shfl_sync(~0u, first, leader);
  return first + __popc(peers & ((1u << lane) - 1));
}

__global__ void __launch_bounds__(kPlanThreads)
    count_lists_kernel(const __grid_constant__ RenderCall call) {
  __shared__ uint32_t of_class[kListClasses];
  __shared__ unsigned long long instances;
  const int lane = threadIdx.x & 31;
  if (threadIdx.x < kListClasses) of_class[threadIdx.x] = 0;
  if (threadIdx.x == 0) instances = 0;
  __syncthreads();
  const PlannedTile tile(call);
  next_place(of_class, length_class(tile.count), tile.exists, lane);
  const uint32_t sum = __reduce_add_sync(~0u, tile.taken);
  if (lane == 0) atomicAdd(&instances, (unsigned long long)sum);
  __syncthreads();
  if (threadIdx.x < kListClasses && of_class[threadIdx.x] > 0) {
    atomicAdd(call.counters->lists + threadIdx.x, of_class[threadIdx.x]);
  }
  if (threadIdx.x == 0) atomicAdd(&call.counters->instances, instances);
}

/// The order of lists in memory and within a class is arbitrary, which does not affect the results.
__global__ void __launch_bounds__(kPlanThreads)
    plan_kernel(const __grid_constant__ RenderCall call, long long* rejected,
                volatile uint64_t* inbox) {
  __shared__ uint32_t next_of_class[kListClasses], warp_sums[kPlanThreads / 32];
  __shared__ unsigned long long first;
  const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5;
  if (threadIdx.x < kListClasses) next_of_class[threadIdx.x] = 0;
  __syncthreads();
  const PlannedTile tile(call);
  const int list_class = length_class(tile.count);
  const uint32_t in_block = next_place(next_of_class, list_class, tile.exists, lane);
  const uint32_t scanned = inclusive_scan(tile.taken, lane);
  if (lane == 31) warp_sums[warp] = scanned;
  __syncthreads();
  if (warp == 0) {
    uint32_t before = 0;  // lists of earlier classes
    for (int k = lane; k < kListClasses; k += 32) {
      const uint32_t lists = call.counters->lists[k], sum = inclusive_scan(lists, lane);
      const uint32_t of_block = next_of_class[k];
      uint32_t others = 0;  // in places that other blocks have taken
      if (of_block > 0) others = atomicAdd(call.counters->placed + k, of_block);
      next_of_class[k] = before + sum - lists + others;
      before += __shfl_sync(~0u, sum, 31);
    }
  } else if (threadIdx.x == 32) {
    unsigned long long total = 0;
    for (const uint32_t sum : warp_sums) total += sum;
    first = atomicAdd(&call.counters->planned, total);
  }
  __syncthreads();
  if (tile.exists) {
    unsigned long long begin = first + scanned - tile.taken;
    for (int w = 0; w < warp; ++w) begin += warp_sums[w];
    const bool fits = begin + tile.count <= call.capacity && tile.count == tile.taken && !tile.lost;
    const uint32_t at = fits ? uint32_t(begin) : call.capacity;
    call.tile_list[tile.tile] = {tile.count, at, at};
    call.tile_order[next_of_class[list_class] + in_block] = tile.tile;
  }
  if (blockIdx.x > 0 || threadIdx.x > 0) return;
  if (inbox != nullptr) {
    inbox[0] = call.counters->instances;
    inbox[1] = call.count;
  }
  if (rejected != nullptr) *rejected = (long long)call.counters->rejected;
}

constexpr int kEmitThreads = 256;

/// Instances of one thread that have no slot yet, in registers.
struct PendingInstances {
  static constexpr int kMost = 4;
  uint64_t keys[kMost];
  int tiles[kMost];
  int count = 0;

  __device__ __forceinline__ void push(uint64_t key, int tile) {
#pragma unroll
    for (int k = 0; k < kMost; ++k) {
      keys[k] = k == count ? key : keys[k];
      tiles[k] = k == count ? tile : tiles[k];
    }
    ++count;
  }
  __device__ __forceinline__ void write(const RenderCall& call, TileList* lists) {
    uint32_t slots[kMost];
#pragma unroll
    for (int k = 0; k < kMost; ++k) {
      if (k < count) slots[k] = atomicAdd(&lists[tiles[k]].next, 1u);
    }
#pragma unroll
    for (int k = 0; k < kMost; ++k) {
      if (k < count && slots[k] < call.capacity) call.keys[slots[k]] = keys[k];
    }
    count = 0;
  }
};

__global__ void __launch_bounds__(kEmitThreads)
    emit_kernel(const __grid_constant__ RenderCall call) {
  // Neighbouring blocks process different views, so that their atomics conflict less.
  const int view = blockIdx.x % call.views;
  const int index = blockIdx.x / call.views * kEmitThreads + threadIdx.x;
  Splat splat{};
  if (index < call.count) splat = load_splat(call.splats + int64_t(view) * call.count + index);
  // A few instances are collected before their slots are requested, so that the latencies of the
  // atomics overlap.
  TileList* const lists = call.tile_list + view * call.tiles;
  PendingInstances pending;
  uint64_t key = 0;
  walk_tiles(
      splat, splat.depth > 0, call,
      [&](int owner, int) {
        const float depth = __shfl_sync(~0u, splat.depth, owner);
        key = make_key(depth, index - int(threadIdx.x & 31) + owner, 0);
      },
      [&](int tile, uint32_t mask) {
        pending.push(key | mask, tile);
        if (pending.count == PendingInstances::kMost) pending.write(call, lists);
      });
  pending.write(call, lists);
}

// ---- sort -------------------------------------------------------------------------------------

constexpr int kSortThreads = 256;
constexpr int kPerThread = 8;
constexpr int kChunk = kSortThreads * kPerThread;  ///< keys in shared memory
constexpr int kBuckets = 1024;
constexpr uint32_t kMaxBucket = 48;  ///< a fuller bucket uses the bitonic sort

__device__ __forceinline__ void order(uint64_t* low, uint64_t* high) {
  const uint64_t a = *low, b = *high;
  if (a > b) {
    *low = b;
    *high = a;
  }
}

/// Merge steps of a bitonic sort in which every comparison puts the smaller key first, so that keys
/// beyond `count` act as infinite without existing. `size`: of the sequence that starts as two
/// sorted halves (flip) or as a bitonic sequence.
__device__ __forceinline__ void flip_step(uint64_t* keys, int count, int size) {
  const int half = size / 2;
  const int pairs = (count + size - 1) / size * half;
  for (int p = threadIdx.x; p < pairs; p += kSortThreads) {
    const int in = p & (half - 1), start = (p / half) * size;
    const int low = start + in, high = start + size - 1 - in;
    if (high < count) order(keys + low, keys + high);
  }
  __syncthreads();
}

__device__ __forceinline__ void stride_step(uint64_t* keys, int count, int stride) {
  const int pairs = (count + 2 * stride - 1) / (2 * stride) * stride;
  for (int p = threadIdx.x; p < pairs; p += kSortThreads) {
    const int low = (p / stride) * 2 * stride + (p & (stride - 1));
    if (low + stride < count) order(keys + low, keys + low + stride);
  }
  __syncthreads();
}

/// Any length: sorts chunks in shared memory and merges them in place.
__device__ __noinline__ void bitonic_sort(uint64_t* keys, int count, uint64_t* shared) {
  for (int first = 0; first < count; first += kChunk) {
    const int size = min(kChunk, count - first);
    for (int i = threadIdx.x; i < size; i += kSortThreads) shared[i] = keys[first + i];
    __syncthreads();
    for (int k = 2; k / 2 < size; k *= 2) {
      flip_step(shared, size, k);
      for (int stride = k / 4; stride > 0; stride /= 2) stride_step(shared, size, stride);
    }
    for (int i = threadIdx.x; i < size; i += kSortThreads) keys[first + i] = shared[i];
    __syncthreads();
  }
  for (int64_t k = 2 * kChunk; k / 2 < count; k *= 2) {
    flip_step(keys, count, int(k));
    for (int stride = int(k / 4); stride >= kChunk; stride /= 2) stride_step(keys, count, stride);
    for (int first = 0; first < count; first += kChunk) {
      const int size = min(kChunk, count - first);
      for (int i = threadIdx.x; i < size; i += kSortThreads) shared[i] = keys[first + i];
      __syncthreads();
      for (int stride = kChunk / 2; stride > 0; stride /= 2) stride_step(shared, size, stride);
      for (int i = threadIdx.x; i < size; i += kSortThreads) keys[first + i] = shared[i];
      __syncthreads();
    }
  }
}

struct SortShared {
  uint64_t keys[kChunk];
  uint32_t bucket[kBuckets];
  uint32_t warp_sum[kSortThreads / 32];
  uint32_t lowest, highest, fullest, gathered;
};

/// Fetches the tile's runs from all chunks of its view, in arbitrary order. A warp takes 32 runs at
/// a time and distributes their keys over its lanes.
__device__ __forceinline__ void gather_runs(const RenderCall& call, uint32_t global_tile,
                                            uint64_t* keys, uint32_t* gathered) {
  const uint32_t* const runs = call.runs + int64_t(global_tile) * call.chunks;
  const uint32_t* const begins = call.chunk_begin + int64_t(global_tile / call.tiles) * call.chunks;
  const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5;
  const int share = (call.chunks + kSortThreads / 32 - 1) / (kSortThreads / 32);
  const int end = min((warp + 1) * share, call.chunks);
  if (threadIdx.x == 0) *gathered = 0;
  __syncthreads();
  for (int base = warp * share; base < end; base += 32) {
    uint32_t length = 0, from = 0;
    if (base + lane < end) {
      const uint32_t run = runs[base + lane];
      length = run & ((1u << kRunBits) - 1);
      from = begins[base + lane] + (run >> kRunBits);
    }
    const Shares shares(length, lane);
    uint32_t to = 0;
    if (lane == 0) to = atomicAdd(gathered, shares.total);
    to = __shfl_sync(~0u, to, 0);
    for (uint32_t first = 0; first < shares.total; first += 32) {
      const uint32_t i = first + lane;
      const uint32_t source = i + __shfl_sync(~0u, from - shares.begin, shares.owner(i));
      if (i < shares.total) keys[to + i] = call.chunk_keys[source];
    }
  }
  __syncthreads();
}

/// For up to kChunk keys: distributes them over buckets that are monotone in depth, then ranks each
/// key within its bucket and writes its entry. Returns false, with the keys unchanged, if a bucket
/// is too full. The keys may be those in s.
__device__ __forceinline__ bool bucket_sort(const uint64_t* keys, int count, SortShared& s,
                                            uint32_t* entries) {
  uint64_t mine[kPerThread];
  uint32_t low = ~0u, high = 0;
#pragma unroll
  for (int k = 0; k < kPerThread; ++k) {
    if (k * kSortThreads >= count) break;
    const int i = k * kSortThreads + threadIdx.x;
    if (i < count) {
      mine[k] = keys[i];
      const uint32_t depth = uint32_t(mine[k] >> 32);
      low = min(low, depth);
      high = max(high, depth);
    }
  }
  if (threadIdx.x == 0) {
    s.lowest = ~0u;
    s.highest = s.fullest = 0;
  }
  for (int i = threadIdx.x; i < kBuckets; i += kSortThreads) s.bucket[i] = 0;
  __syncthreads();
  low = __reduce_min_sync(~0u, low);
  high = __reduce_max_sync(~0u, high);
  if ((threadIdx.x & 31) == 0) {
    atomicMin(&s.lowest, low);
    atomicMax(&s.highest, high);
  }
  __syncthreads();
  const uint32_t lowest = s.lowest, range = s.highest - lowest;
  // bucket = (depth − lowest) · scale / 2^32 < kBuckets
  const uint32_t scale =
      uint32_t(min((uint64_t(kBuckets) << 32) / (uint64_t(range) + 1), uint64_t(~0u)));
  uint32_t place[kPerThread];  // bucket << 16 | rank in it: registers limit the occupancy
  static_assert(kChunk <= 1 << 16 && kBuckets <= 1 << 16, "both fit");
#pragma unroll
  for (int k = 0; k < kPerThread; ++k) {
    if (k * kSortThreads >= count) break;
    if (k * kSortThreads + threadIdx.x < count) {
      const uint32_t bucket =
          min(__umulhi(uint32_t(mine[k] >> 32) - lowest, scale), uint32_t(kBuckets - 1));
      place[k] = bucket << 16 | atomicAdd(&s.bucket[bucket], 1u);
    }
  }
  __syncthreads();
  // Exclusive scan of the buckets, four per thread.
  static_assert(kBuckets == 4 * kSortThreads, "each thread scans four buckets");
  uint4 counts = reinterpret_cast<uint4*>(s.bucket)[threadIdx.x];
  const uint32_t fullest = max(max(counts.x, counts.y), max(counts.z, counts.w));
  const uint32_t sum = counts.x + counts.y + counts.z + counts.w;
  const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5;
  const uint32_t scanned = inclusive_scan(sum, lane);
  if (lane == 31) s.warp_sum[warp] = scanned;
  const uint32_t warp_fullest = __reduce_max_sync(~0u, fullest);
  if (lane == 0) atomicMax(&s.fullest, warp_fullest);
  __syncthreads();
  if (s.fullest > kMaxBucket) return false;
  uint32_t start = scanned - sum;
  for (int w = 0; w < warp; ++w) start += s.warp_sum[w];
  reinterpret_cast<uint4*>(s.bucket)[threadIdx.x] = make_uint4(
      start, start + counts.x, start + counts.x + counts.y, start + counts.x + counts.y + counts.z);
  __syncthreads();
#pragma unroll
  for (int k = 0; k < kPerThread; ++k) {
    if (k * kSortThreads >= count) break;
    if (k * kSortThreads + threadIdx.x < count) {
      s.keys[s.bucket[place[k] >> 16] + (place[k] & 0xffff)] = mine[k];
    }
  }
  __syncthreads();
#pragma unroll
  for (int k = 0; k < kPerThread; ++k) {
    if (k * kSortThreads >= count) break;
    if (k * kSortThreads + threadIdx.x < count) {
      const uint32_t bucket = place[k] >> 16, begin = s.bucket[bucket];
      const uint32_t end = bucket + 1 < kBuckets ? s.bucket[bucket + 1] : uint32_t(count);
      uint32_t at = begin;
      for (uint32_t i = begin; i < end; ++i) at += s.keys[i] < mine[k];
      entries[at] = uint32_t(mine[k]);
    }
  }
  return true;
}

/// Replaces a list of sorted keys by the list of their entries, in place.
__device__ void keep_entries(uint64_t* keys, int count) {
  for (int first = 0; first < count; first += kSortThreads) {
    const int i = first + threadIdx.x;
    const uint32_t entry = i < count ? uint32_t(keys[i]) : 0;
    __syncthreads();
    if (i < count) reinterpret_cast<uint32_t*>(keys)[i] = entry;
    __syncthreads();
  }
}

template <bool kRuns>
__global__ void __launch_bounds__(kSortThreads, 6)
    sort_kernel(const __grid_constant__ RenderCall call) {
  __shared__ SortShared shared;
  const uint32_t tile = call.tile_order[blockIdx.x];
  const TileList list = call.tile_list[tile];
  if (list.count == 0 || list.begin >= call.capacity) return;
  uint64_t* const keys = call.keys + list.begin;
  auto* const entries = reinterpret_cast<uint32_t*>(keys);
  const int count = int(list.count);
  if (count <= kChunk) {
    if (kRuns) gather_runs(call, tile, shared.keys, &shared.gathered);
    if (bucket_sort(kRuns ? shared.keys : keys, count, shared, entries)) return;
    __syncthreads();
    for (int i = threadIdx.x; kRuns && i < count; i += kSortThreads) keys[i] = shared.keys[i];
  } else if (kRuns) {
    gather_runs(call, tile, keys, &shared.gathered);
  }
  __syncthreads();
  bitonic_sort(keys, count, shared.keys);
  keep_entries(keys, count);
}

int plan_blocks(const RenderCall& call) {
  return (call.views * call.tiles + kPlanThreads - 1) / kPlanThreads;
}

}  // namespace

void launch_count_lists(const RenderCall& call, cudaStream_t stream) {
  count_lists_kernel<<<plan_blocks(call), kPlanThreads, 0, stream>>>(call);
}

void launch_plan(const RenderCall& call, long long* rejected, volatile uint64_t* inbox,
                 cudaStream_t stream) {
  plan_kernel<<<plan_blocks(call), kPlanThreads, 0, stream>>>(call, rejected, inbox);
}

void launch_fill(const RenderCall& call, cudaStream_t stream) {
  if (call.count == 0) return;
  if (call.chunks > 0) {
    sort_kernel<true><<<call.views * call.tiles, kSortThreads, 0, stream>>>(call);
    return;
  }
  const int blocks = (call.count + kEmitThreads - 1) / kEmitThreads * call.views;
  emit_kernel<<<blocks, kEmitThreads, 0, stream>>>(call);
  sort_kernel<false><<<call.views * call.tiles, kSortThreads, 0, stream>>>(call);
}

}  // namespace jade::splat::cuda
