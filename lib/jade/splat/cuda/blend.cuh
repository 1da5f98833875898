// SPDX-License-Identifier: Apache-2.0
// Shared by both blending passes: a warp's pixels and its walk through a tile's list.
#pragma once

#include "jade/splat/cuda/unlisted.cuh"
#include "jade/splat/math/blend.h"

namespace jade::splat::cuda {

constexpr int kGroup = 8;  ///< splats between two checks for stopped pixels

/// Splats being loaded for a warp's pixels.
struct WarpStage {
  float4 splat[32][3];
  uint32_t entry[64];     ///< waiting to be loaded
  uint32_t position[64];  ///< in the tile's list
};

/// The arithmetic of math::blend_step() by the special function units, 2 ulp.
struct FastArithmetic {
  static __device__ __forceinline__ float exp2_where(bool mask, float x) {
    float value = 0;
#ifdef __CUDACC__
    if (mask) asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(value) : "f"(x));
#else
    if (mask) value = exp2f(x);  // tests/emulated
#endif
    return value;
  }
  static __device__ __forceinline__ float product(float a, float b) { return __fmul_rn(a, b); }
  static __device__ __forceinline__ float times_ratio(float x, float a, float b) {
    return __fdividef(x * a, b);
  }
};

/// One block's tile and one lane's two pixels, side by side in the warp's quarter.
struct Pixels {
  int view, tile, tile_x, tile_y, quarter;
  int x[2], y;
  bool inside[2];
  int64_t offset[2];  ///< in a plane of the view's image

  __device__ explicit Pixels(const RenderCall& call) {
    const int global_tile = call.tile_order[blockIdx.x], lane = threadIdx.x & 31;
    view = global_tile / call.tiles;
    tile = global_tile - view * call.tiles;
    tile_y = tile / call.tiles_x;
    tile_x = tile - tile_y * call.tiles_x;
    quarter = threadIdx.x >> 5;
    y = tile_y * kTile + (quarter >> 1) * kSubtile + (lane >> 2);
    for (int k = 0; k < 2; ++k) {
      x[k] = tile_x * kTile + (quarter & 1) * kSubtile + 2 * (lane & 3) + k;
      inside[k] = x[k] < call.width && y < call.height;
      offset[k] = int64_t(y) * call.width + x[k];
    }
  }

  /// Column of a place in the quarter, place = 8 · row + column. A lane owns 2 · lane and the next.
  __device__ __forceinline__ int x_of(int place) const {
    return tile_x * kTile + (quarter & 1) * kSubtile + place % kSubtile;
  }
  __device__ __forceinline__ int y_of(int place) const {
    return tile_y * kTile + (quarter >> 1) * kSubtile + place / kSubtile;
  }
};

/// The alive pixels of a quarter: those with a positive transmittance.
struct AlivePixels {
  uint32_t first, second;  ///< bit i: lane i's pixels 0 and 1

  __device__ __forceinline__ explicit AlivePixels(const float* t)
      : first(__ballot_sync(~0u, t[0] > 0.0f)), second(__ballot_sync(~0u, t[1] > 0.0f)) {}
  __device__ __forceinline__ bool any() const { return (first | second) != 0; }
  __device__ __forceinline__ int count() const { return __popc(first) + __popc(second); }
};

/// One pixel per lane instead of two, for a quarter with at most 32 alive pixels: most splats late
/// in a list reach few of these, so that two pixels per lane would waste steps.
class OnePixel {
 public:
  /// @param places  [32] of the warp's shared memory
  __device__ __forceinline__ OnePixel(const AlivePixels& alive, uint8_t* places) {
    const int lane = threadIdx.x & 31, of_first = __popc(alive.first);
    const uint32_t before = (1u << lane) - 1;
    if (alive.first >> lane & 1) places[__popc(alive.first & before)] = uint8_t(2 * lane);
    if (alive.second >> lane & 1) {
      places[of_first + __popc(alive.second & before)] = uint8_t(2 * lane + 1);
    }
    __syncwarp();
    taken_ = lane < alive.count();
    place_ = taken_ ? places[lane] : 0;
  }
  __device__ __forceinline__ bool taken() const { return taken_; }  ///< else the lane has no pixel
  /// Place of its pixel before compaction: 2 · lane + 0 or 1.
  __device__ __forceinline__ int place() const { return place_; }
  /// Moves a value of the pixel to values[0]. All lanes must call it.
  __device__ __forceinline__ void take(float* values) const {
    const float even = __shfl_sync(~0u, values[0], place_ >> 1);
    const float odd = __shfl_sync(~0u, values[1], place_ >> 1);
    values[0] = place_ & 1 ? odd : even;
  }
  /// The pixel's own transmittance; pixel 1 is marked as stopped.
  __device__ __forceinline__ void take_transmittance(float* t) const {
    take(t);
    if (!taken_) t[0] = -1.0f;
    t[1] = -1.0f;
  }

 private:
  int place_;
  bool taken_;
};

/// Calls blend(j, j − first) for the splats of a group. Nearly all groups are full: the loop then
/// counts only splats, kUnroll of them at a time.
template <int kUnroll, class Blend>
__device__ __forceinline__ void for_group(int first, int end, const Blend& blend) {
  if (end - first == kGroup) {
#pragma unroll kUnroll
    for (int k = 0; k < kGroup; ++k) blend(first + k, k);
  } else {
#pragma unroll 1
    for (int j = first; j < end; ++j) blend(j, j - first);
  }
}

/// Streams the splats of a list that reach the warp's quarter through `stage`, in order, in groups
/// of at most eight: calls alive() before each group, and group(first, end) for the splats at
/// stage.splat[first … end − 1]. After at most 32 splats, and when no pixel is alive, calls
/// seen(count) for those processed since, at stage.position from 0 on. Returns whether a pixel was
/// still alive at the end.
template <class Alive, class Group, class Seen>
__device__ __forceinline__ bool stream(const uint32_t* list, int count, int quarter,
                                       const Splat* splats, WarpStage& stage, const Alive& alive,
                                       const Group& group, const Seen& seen) {
  const int lane = threadIdx.x & 31;
  const uint32_t before = (1u << lane) - 1;
  int waiting = 0;
  uint32_t entry = lane < count ? list[lane] : 0;
  for (int base = 0; base < count || waiting > 0; base += 32) {
    const uint32_t now = entry;
    entry = base + 32 + lane < count ? list[base + 32 + lane] : 0;
    const bool hit = now >> quarter & 1;
    const uint32_t hits = __ballot_sync(~0u, hit);
    if (hit) {
      stage.entry[waiting + __popc(hits & before)] = now;
      stage.position[waiting + __popc(hits & before)] = base + lane;
    }
    waiting += __popc(hits);
    __syncwarp();
    const int ready = base + 32 >= count ? min(waiting, 32) : waiting & 32;
    if (ready == 0) continue;
    uint32_t later_entry = 0, later_position = 0;
    if (lane < ready) {
      const float4* const source =
          reinterpret_cast<const float4*>(splats + (stage.entry[lane] >> kMaskBits));
      for (int k = 0; k < 3; ++k) stage.splat[lane][k] = __ldg(source + k);
    }
    if (lane + 32 < waiting) {
      later_entry = stage.entry[lane + 32];
      later_position = stage.position[lane + 32];
    }
    __syncwarp();
    for (int begin = 0; begin < ready; begin += kGroup) {
      if (!alive()) {
        seen(begin);
        return false;
      }
      group(begin, min(begin + kGroup, ready));
    }
    seen(ready);
    __syncwarp();
    waiting -= ready;
    if (lane < waiting) {
      stage.entry[lane] = later_entry;
      stage.position[lane] = later_position;
    }
    __syncwarp();
  }
  return alive();
}

/// Streams the whole tile, listed or not; calls seen(list, count) as in stream(), with null for
/// unlisted ones.
template <class Alive, class Group, class Seen>
__device__ __forceinline__ void stream_tile(const RenderCall& call, const Pixels& pixels,
                                            WarpStage& stage, RoundShared& round,
                                            uint64_t* round_keys, const Alive& alive,
                                            const Group& group, const Seen& seen) {
  const TileList list = call.tile_list[pixels.view * call.tiles + pixels.tile];
  const Splat* const splats = call.splats + int64_t(pixels.view) * call.count;
  if (list.count == 0) return;
  if (list.begin < call.capacity) {
    auto* const entries = reinterpret_cast<uint32_t*>(call.keys + list.begin);
    stream(entries, int(list.count), pixels.quarter, splats, stage, alive, group,
           [&](int count) { seen(entries, count); });
    return;
  }
  uint64_t last = 0;
  for (;;) {
    const int found =
        select_round(call, pixels.view, pixels.tile_x, pixels.tile_y, round, round_keys, &last);
    const bool on = stream(round.entries, found, pixels.quarter, splats, stage, alive, group,
                           [&](int count) { seen(static_cast<uint32_t*>(nullptr), count); });
    if (__syncthreads_or(on && found == kRound) == 0) return;
  }
}

}  // namespace jade::splat::cuda
