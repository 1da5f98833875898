// SPDX-License-Identifier: Apache-2.0
// Shared by both blending passes: a warp's pixels and its walk through a tile's list.
#pragma once

#include <type_traits>

#include "jade/splat/cuda/unlisted.cuh"
#include "jade/splat/math/blend.h"

namespace jade::splat::cuda {

constexpr int kGroup = 8;  ///< splats between two checks for stopped pixels

/// The arithmetic of math/blend.h by the special function units, 2 ulp.
struct FastArithmetic {
  static __device__ __forceinline__ float exp2(float x) {
#ifdef __CUDACC__
    float value;
    asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(value) : "f"(x));
    return value;
#else
    return exp2f(x);  // tests/emulated
#endif
  }
  static __device__ __forceinline__ float exp2_where(bool mask, float x) {
    const float value = exp2(x);
    return mask ? value : 0;
  }
  static __device__ __forceinline__ float cap(float alpha, float max_alpha) {
    return fminf(alpha, max_alpha);
  }
  static __device__ __forceinline__ float product(float a, float b) { return __fmul_rn(a, b); }
  static __device__ __forceinline__ float ratio(float a, float b) {
#ifdef __CUDACC__
    float inverse;  // b is never small enough for the range checks of a division
    asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(inverse) : "f"(b));
    return a * inverse;
#else
    return a / b;     // tests/emulated
#endif
  }
};

/// Offset of a row's or column's pixel centres from the middle of the quarter.
__device__ __forceinline__ float from_middle(int line) {
  return float(line) - 0.5f * (kSubtile - 1);
}

/// One block's tile and one lane's two pixels, side by side in the warp's quarter.
struct Pixels {
  int view, tile, quarter;
  int left, top;  ///< of the quarter, px
  bool inside[2];
  int64_t offset[2];  ///< in a plane of the view's image

  __device__ explicit Pixels(const RenderCall& call) {
    const int global_tile = call.tile_order[blockIdx.x], lane = threadIdx.x & 31;
    view = global_tile / call.tiles;
    tile = global_tile - view * call.tiles;
    quarter = threadIdx.x >> 5;
    top = tile / call.tiles_x * kTile + (quarter >> 1) * kSubtile;
    left = tile % call.tiles_x * kTile + (quarter & 1) * kSubtile;
    for (int k = 0; k < 2; ++k) {
      const int x = x_of(2 * lane + k), y = y_of(2 * lane);
      inside[k] = x < call.width && y < call.height;
      offset[k] = int64_t(y) * call.width + x;
    }
  }

  /// Column of a place in the quarter, place = 8 · row + column. A lane owns 2 · lane and the next.
  __device__ __forceinline__ int x_of(int place) const { return left + place % kSubtile; }
  __device__ __forceinline__ int y_of(int place) const { return top + place / kSubtile; }
};

/// A splat as a quarter's pixels need it. 80 bytes, so that lanes that write 16 bytes each have no
/// bank conflicts.
struct alignas(16) QuarterSplat {
  float2 row[kSubtile];  ///< b and c of RowFalloff from the middle of each of the quarter's rows
  float4 color_a;        ///< red, green, blue; a of all rows

  __device__ __forceinline__ m::RowFalloff<float> falloff(int line) const {
    return {color_a.w, row[line].x, row[line].y};
  }
};

constexpr float kInvisible = -1e30f;  ///< log2 of an opacity

/// Splats being loaded for a warp's pixels.
struct WarpStage {
  QuarterSplat splat[32];
  float2 offset[32];  ///< from the splat to the quarter's middle
  float depth[32];
  uint32_t entry[64];     ///< waiting to be loaded
  uint32_t position[64];  ///< in the tile's list

  /// Sets splat[i]; returns whether its α can exceed the maximum in the quarter.
  __device__ __forceinline__ bool set(int i, const Splat& s, const Pixels& pixels,
                                      float log2_max_alpha) {
    const float dx = float(pixels.left + kSubtile / 2) - s.x;
    const float dy = float(pixels.top + kSubtile / 2) - s.y;
    const m::Falloff<float> falloff{s.a, s.b, s.c};
    const auto f = m::about(falloff, s.log2_opacity, dx, dy);
#pragma unroll
    for (int line = 0; line < kSubtile; line += 2) {
      const auto one = m::at_row(f, from_middle(line)), two = m::at_row(f, from_middle(line + 1));
      *reinterpret_cast<float4*>(splat[i].row + line) = make_float4(one.b, one.c, two.b, two.c);
    }
    splat[i].color_a = make_float4(s.red, s.green, s.blue, s.a);
    offset[i] = make_float2(dx, dy);
    depth[i] = s.depth;
    return m::exponent_bound(falloff, s.log2_opacity, dx, dy) > log2_max_alpha;
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

/// Calls blend(j, j − first, std::bool_constant capped) for every kStep-th splat of a group. Nearly
/// all groups are full: the loop then counts only splats, kUnroll steps at a time.
template <int kStep, int kUnroll, class Blend>
__device__ __forceinline__ void for_group(int first, int end, bool capped, const Blend& blend) {
  const auto full = [&](auto cap) {
#pragma unroll kUnroll
    for (int k = 0; k < kGroup; k += kStep) blend(first + k, k, cap);
  };
  if (end - first < kGroup) {
#pragma unroll 1
    for (int j = first; j < end; j += kStep) blend(j, j - first, std::true_type());
  } else if (capped) {
    full(std::true_type());
  } else {
    full(std::false_type());
  }
}

/// Streams the splats of a list that reach the warp's quarter through `stage`, in order, in groups
/// of at most eight: calls alive() before each group, and group(first, end, capped) for the splats
/// at stage.splat[first … end − 1]; `capped` if the α of one of them can exceed its maximum. An
/// odd number of splats is followed by one that is visible nowhere. After at most 32 splats, and
/// when no pixel is alive, calls seen(count) for those processed since, at stage.position from 0
/// on. Returns whether a pixel was still alive at the end.
template <class Alive, class Group, class Seen>
__device__ __forceinline__ bool stream(const RenderCall& call, const Pixels& pixels,
                                       const uint32_t* list, int count, WarpStage& stage,
                                       const Alive& alive, const Group& group, const Seen& seen) {
  const Splat* const splats = call.splats + int64_t(pixels.view) * call.count;
  const int lane = threadIdx.x & 31, quarter = pixels.quarter;
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
    Splat splat{};
    splat.log2_opacity = kInvisible;
    if (lane < ready) splat = load_splat(splats + (stage.entry[lane] >> kMaskBits));
    const bool capped = stage.set(lane, splat, pixels, call.log2_max_alpha);
    const uint32_t all_capped = __ballot_sync(~0u, capped);
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
      group(begin, min(begin + kGroup, ready), (all_capped >> begin & ((1u << kGroup) - 1)) != 0);
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
  if (list.count == 0) return;
  const bool listed = list.begin < call.capacity;
  auto* const entries = listed ? reinterpret_cast<uint32_t*>(call.keys + list.begin) : nullptr;
  uint64_t last = 0;
  for (;;) {
    const int found = listed ? int(list.count)
                             : select_round(call, pixels.view, pixels.left / kTile,
                                            pixels.top / kTile, round, round_keys, &last);
    const bool on = stream(call, pixels, listed ? entries : round.entries, found, stage, alive,
                           group, [&](int count) { seen(entries, count); });
    if (listed || __syncthreads_or(on && found == kRound) == 0) return;
  }
}

}  // namespace jade::splat::cuda
