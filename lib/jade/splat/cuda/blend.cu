// SPDX-License-Identifier: Apache-2.0
// Blending and its adjoint: one block per tile, one warp per quarter of it, one lane per two
// pixels, or per one pixel late in a list of the forward pass.
#include <type_traits>

#include "jade/splat/cuda/blend.cuh"
#include "jade/splat/cuda/launch.h"
#include "jade/splat/cuda/warp.cuh"

namespace jade::splat::cuda {

namespace {

/// A pixel's transmittance is negative once it has stopped; pixels outside the image start so.
__device__ __forceinline__ float first_transmittance(bool inside) { return inside ? 1.0f : -1.0f; }

__device__ __forceinline__ bool any_alive(const float* t) {
  return __any_sync(~0u, t[0] > 0.0f || t[1] > 0.0f);
}

/// Zeroes this thread's share. Blending is limited by instructions, so these stores are nearly
/// free.
__device__ __forceinline__ void clear(const Clearing& clearing) {
  const int64_t threads = int64_t(gridDim.x) * kBlendThreads;
  for (int64_t i = int64_t(blockIdx.x) * kBlendThreads + threadIdx.x; 16 * i < clearing.bytes;
       i += threads) {
    static_cast<float4*>(clearing.memory)[i] = make_float4(0, 0, 0, 0);
  }
}

constexpr int kBlendBlocks = 8;  ///< per multiprocessor

/// Running sums of a lane's pixels.
struct PixelSums {
  float t[2], red[2] = {0, 0}, green[2] = {0, 0}, blue[2] = {0, 0}, depth[2] = {0, 0};
};

template <bool kDepth>
__device__ __forceinline__ void store_pixel(const RenderCall& call, const Images& images,
                                            const Pixels& pixels, int place, int k,
                                            const PixelSums& s) {
  const int x = pixels.x_of(place), y = pixels.y_of(place);
  if (x >= call.width || y >= call.height) return;
  const int64_t plane = int64_t(call.width) * call.height;
  const int64_t i = int64_t(y) * call.width + x;
  float* const color = images.color + 3 * pixels.view * plane + i * call.pixel_stride;
  const int64_t next = call.channel_stride;
  const float t = fabsf(s.t[k]);
  const auto behind = [&](int c) {
    return call.background != nullptr ? t * call.background[c] : 0;
  };
  color[0] = s.red[k] + behind(0);
  color[next] = s.green[k] + behind(1);
  color[2 * next] = s.blue[k] + behind(2);
  images.alpha[pixels.view * plane + i] = 1.0f - t;
  if (kDepth) images.depth_sum[pixels.view * plane + i] = s.depth[k];
}

/// kGradient: a gradient is required. Entries then drop the quarters in which their splat changed
/// no pixel, for example because all of them have stopped, so that the adjoint skips them. While
/// most pixels are alive, nearly every splat changes one, so this is not checked.
template <bool kDepth, bool kGradient>
__global__ void __launch_bounds__(kBlendThreads, kBlendBlocks)
    blend_kernel(const __grid_constant__ RenderCall call, const Images images,
                 const Clearing clearing) {
  __shared__ WarpStage stages[kBlendThreads / 32];
  __shared__ RoundShared round;
  __shared__ uint64_t round_keys[kRoundKeys];
  __shared__ uint8_t places[kBlendThreads / 32][32];
  const Pixels pixels(call);
  WarpStage& stage = stages[pixels.quarter];
  if (kGradient) clear(clearing);
  int place = 2 * (threadIdx.x & 31);  // of the lane's first pixel; −1 if none is alive
  float px[2] = {float(pixels.x[0]) + 0.5f, float(pixels.x[1]) + 0.5f};
  float py = float(pixels.y) + 0.5f;
  PixelSums s;
  for (int k = 0; k < 2; ++k) s.t[k] = first_transmittance(pixels.inside[k]);
  const auto blend = [&](int j, auto count) {
    const float4 p = stage.splat[j][0], q = stage.splat[j][1], r = stage.splat[j][2];
    const m::Falloff<float> falloff{p.z, p.w, q.x};
    const m::RowFalloff<float> row = m::at_row(falloff, q.y, py - p.y);
#pragma unroll
    for (int k = 0; k < decltype(count)::value; ++k) {
      const auto step = m::blend_step<FastArithmetic, false>(m::exponent(row, px[k] - p.x),
                                                             call.max_alpha, &s.t[k]);
      s.red[k] = fmaf(step.weight, q.z, s.red[k]);
      s.green[k] = fmaf(step.weight, q.w, s.green[k]);
      s.blue[k] = fmaf(step.weight, r.x, s.blue[k]);
      if (kDepth) s.depth[k] = fmaf(step.weight, r.y, s.depth[k]);
    }
  };
  bool narrow = false;    // one pixel per lane
  uint32_t changing = 0;  // bit j: the splat at stage.splat[j] changed this lane's pixel
  const auto begin_narrow = [&](const AlivePixels& alive) {
    for (int k = 0; k < 2; ++k) {
      if (s.t[k] <= 0) store_pixel<kDepth>(call, images, pixels, place + k, k, s);
    }
    const OnePixel one(alive, places[pixels.quarter]);
    one.take_transmittance(s.t);
    one.take(s.red);
    one.take(s.green);
    one.take(s.blue);
    if (kDepth) one.take(s.depth);
    px[0] = float(pixels.x_of(one.place())) + 0.5f;
    py = float(pixels.y_of(one.place())) + 0.5f;
    place = one.taken() ? one.place() : -1;
    narrow = true;
  };
  stream_tile(
      call, pixels, stage, round, round_keys, [&] { return any_alive(s.t); },
      [&](int begin, int end) {
        if (narrow) {
          uint32_t changed = 0;
          for_group<kGroup>(begin, end, [&](int j, int k) {
            const float before = s.t[0];
            blend(j, std::integral_constant<int, 1>());
            if (kGradient && s.t[0] != before) changed |= 1u << k;
          });
          changing |= changed << begin;
        } else {
          for_group<kGroup>(begin, end,
                            [&](int j, int) { blend(j, std::integral_constant<int, 2>()); });
        }
      },
      [&](uint32_t* entries, int count) {
        if (!narrow) {
          const AlivePixels alive(s.t);
          if (alive.any() && alive.count() <= 32) begin_narrow(alive);
          return;
        }
        if (!kGradient) return;
        const int lane = threadIdx.x & 31;
        const uint32_t all = __reduce_or_sync(~0u, changing);
        if (entries != nullptr && lane < count && (all >> lane & 1) == 0) {
          atomicAnd(entries + stage.position[lane], ~(1u << pixels.quarter));
        }
        changing = 0;
      });
  if (place >= 0) store_pixel<kDepth>(call, images, pixels, place, 0, s);
  if (!narrow) store_pixel<kDepth>(call, images, pixels, place + 1, 1, s);
}

// ---- adjoint ----------------------------------------------------------------------------------

/// dL/dpixel and the contribution of the remaining splats (math/blend.h), for one lane.
struct PixelGradients {
  float red[2], green[2], blue[2], depth[2], behind[2];
};

/// Loads the gradients; returns in `background` this lane's part of dL/dbackground.
template <bool kDepth>
__device__ __forceinline__ PixelGradients load_gradients(const RenderCall& call,
                                                         const Pixels& pixels,
                                                         const ImageGradients& images,
                                                         float* background) {
  const int64_t plane = int64_t(call.width) * call.height;
  const int64_t color_at = 3 * pixels.view * plane, alpha_at = pixels.view * plane;
  const int64_t next = call.channel_stride;
  PixelGradients g{};
  for (int c = 0; c < 3; ++c) background[c] = 0;
  for (int k = 0; k < 2; ++k) {
    if (!pixels.inside[k]) continue;
    const int64_t i = pixels.offset[k];
    const float t_end = 1.0f - images.alpha[alpha_at + i];
    if (images.grad_color != nullptr) {
      const float* const grad = images.grad_color + color_at + i * call.pixel_stride;
      const float* const color = images.color + color_at + i * call.pixel_stride;
      g.red[k] = grad[0];
      g.green[k] = grad[next];
      g.blue[k] = grad[2 * next];
      g.behind[k] = g.red[k] * color[0] + g.green[k] * color[next] + g.blue[k] * color[2 * next];
      background[0] += t_end * g.red[k];
      background[1] += t_end * g.green[k];
      background[2] += t_end * g.blue[k];
    }
    // alpha = 1 − T_end, so its gradient acts like a background of −1 in an additional channel.
    if (images.grad_alpha != nullptr) g.behind[k] -= images.grad_alpha[alpha_at + i] * t_end;
    if (kDepth && images.grad_depth_sum != nullptr) {
      g.depth[k] = images.grad_depth_sum[alpha_at + i];
      g.behind[k] += g.depth[k] * images.depth_sum[alpha_at + i];
    }
  }
  return g;
}

__device__ __forceinline__ void add_background(const RenderCall& call, const Pixels& pixels,
                                               const Gradients& gradients, const float* background,
                                               float (*warp_sums)[3]) {
  for (int c = 0; c < 3; ++c) {
    const float sum = warp_sum(background[c]);
    if ((threadIdx.x & 31) == 0) warp_sums[pixels.quarter][c] = sum;
  }
  __syncthreads();
  if (threadIdx.x < 3) {
    float sum = 0;
    for (int w = 0; w < kBlendThreads / 32; ++w) sum += warp_sums[w][threadIdx.x];
    if (gradients.background_partial != nullptr) {
      const int64_t tile = int64_t(pixels.view) * call.tiles + pixels.tile;
      gradients.background_partial[3 * tile + threadIdx.x] = sum;
    } else {
      atomicAdd(gradients.background_sums + threadIdx.x, sum);
    }
  }
}

constexpr int kQuarterPixels = kSubtile * kSubtile;
constexpr int kSplatStride = kQuarterPixels + 16;  ///< avoids bank conflicts of the readers

/// A group's per-pixel gradients of one warp, summed with one lane per splat and pixel block.
struct WarpSums {
  float u[kGroup * kSplatStride];       ///< dL/d ln α
  float weight[kGroup * kSplatStride];  ///< α T
};

/// Four lanes share a splat: lane q of them sums 4 x 1 pixel blocks in rows 2 i + q / 2 and columns
/// from 4 (q % 2). Moments are taken relative to the middle of the lane's pixels, then relative to
/// the splat. Afterwards lane q has sums 2 q and 2 q + 1 of the first eight in values[0] and [1],
/// and every lane has the others.
template <bool kDepth>
__device__ __forceinline__ void sum_splat(const WarpSums& s, const float (*grad)[kQuarterPixels],
                                          int splat, int q, float middle_x, float middle_y,
                                          float* values) {
  float m0 = 0, mx = 0, my = 0, mxx = 0, mxy = 0, myy = 0, color[4] = {0, 0, 0, 0};
#pragma unroll
  for (int i = 0; i < 4; ++i) {
    const int at = (4 * i + q) * 4;
    const float4 u = *reinterpret_cast<const float4*>(s.u + splat * kSplatStride + at);
    const float4 w = *reinterpret_cast<const float4*>(s.weight + splat * kSplatStride + at);
    const float outer = u.x + u.w, inner = u.y + u.z, y = float(2 * i - 3);
    const float row = outer + inner, row_x = 1.5f * (u.w - u.x) + 0.5f * (u.z - u.y);
    m0 += row;
    mx += row_x;
    mxx += 2.25f * outer + 0.25f * inner;
    my += y * row;
    myy += y * y * row;
    mxy += y * row_x;
#pragma unroll
    for (int c = 0; c < 3 + kDepth; ++c) {
      const float4 g = *reinterpret_cast<const float4*>(grad[c] + at);
      color[c] += w.x * g.x + w.y * g.y + w.z * g.z + w.w * g.w;
    }
  }
  const float x1 = mx + middle_x * m0, y1 = my + middle_y * m0;
  values[0] = m0;
  values[1] = x1;
  values[2] = y1;
  values[3] = mxx + middle_x * (mx + x1);
  values[4] = mxy + middle_x * y1 + middle_y * mx;
  values[5] = myy + middle_y * (my + y1);
  values[6] = color[0];
  values[7] = color[1];
  values[8] = color[2];
  exchange_halves<4>(values, 2, q & 2);
  exchange_halves<2>(values, 1, q & 1);
  for (int k = 8; k < m::kPixelSums + kDepth; ++k) {
    if (k == m::kPixelSums) values[k] = color[3];
    values[k] += __shfl_xor_sync(~0u, values[k], 2);
    values[k] += __shfl_xor_sync(~0u, values[k], 1);
  }
}

template <bool kDepth, bool kSlots>
__global__ void __launch_bounds__(kBlendThreads, kDepth || kSlots ? 5 : 6)
    blend_adjoint_kernel(const __grid_constant__ RenderCall call,
                         const __grid_constant__ ImageGradients images,
                         const __grid_constant__ Gradients gradients) {
  constexpr int kValues = m::kPixelSums + kDepth;
  __shared__ WarpStage stages[kBlendThreads / 32];
  __shared__ __align__(16) WarpSums all_sums[kBlendThreads / 32];
  __shared__ __align__(16) float grads[kBlendThreads / 32][3 + kDepth][kQuarterPixels];
  static_assert(sizeof(all_sums) >= kRoundKeys * sizeof(uint64_t), "rounds borrow this memory");
  __shared__ RoundShared round;
  __shared__ float warp_background[kBlendThreads / 32][3];
  const Pixels pixels(call);
  WarpStage& stage = stages[pixels.quarter];
  WarpSums& sums = all_sums[pixels.quarter];
  const int lane = threadIdx.x & 31;
  float background[3];
  PixelGradients g = load_gradients<kDepth>(call, pixels, images, background);
  if (gradients.background != nullptr) {
    add_background(call, pixels, gradients, background, warp_background);
  }
  for (int k = 0; k < 2; ++k) {
    grads[pixels.quarter][0][2 * lane + k] = g.red[k];
    grads[pixels.quarter][1][2 * lane + k] = g.green[k];
    grads[pixels.quarter][2][2 * lane + k] = g.blue[k];
    if (kDepth) grads[pixels.quarter][2 + kDepth][2 * lane + k] = g.depth[k];
  }

  const float px[2] = {float(pixels.x[0]) + 0.5f, float(pixels.x[1]) + 0.5f};
  const float py = float(pixels.y) + 0.5f;
  float t[2];
  for (int k = 0; k < 2; ++k) t[k] = first_transmittance(pixels.inside[k]);
  const int64_t global_tile = int64_t(pixels.view) * call.tiles + pixels.tile;
  const TileList list = call.tile_list[global_tile];
  const bool slots = kSlots && list.begin < call.capacity;
  float* const view_sums = gradients.sums + int64_t(pixels.view) * call.count * kValues;
  // This lane's share of a splat when the group is summed.
  const int q = lane & 3;
  const float middle_x = px[0] - float(2 * (lane & 3)) + float(4 * (q & 1)) + 1.5f;
  const float middle_y = py - float(lane >> 2) + float(q >> 1) + 3.0f;
  uint32_t progress = 0;
  const auto blend = [&](int j, int in_group) {
    const float4 p = stage.splat[j][0], q4 = stage.splat[j][1], r = stage.splat[j][2];
    const m::Falloff<float> falloff{p.z, p.w, q4.x};
    const m::RowFalloff<float> row = m::at_row(falloff, q4.y, py - p.y);
    float u[2], weights[2];
#pragma unroll
    for (int k = 0; k < 2; ++k) {
      const auto step = m::blend_step<FastArithmetic, false>(m::exponent(row, px[k] - p.x),
                                                             call.max_alpha, &t[k]);
      float value = g.red[k] * q4.z + g.green[k] * q4.w + g.blue[k] * r.x;
      if (kDepth) value += g.depth[k] * r.y;
      u[k] =
          m::blend_step_adjoint<FastArithmetic, false>(step, value, call.max_alpha, &g.behind[k]);
      weights[k] = step.weight;
    }
    const int at = in_group * kSplatStride + 2 * lane;
    *reinterpret_cast<float2*>(sums.u + at) = make_float2(u[0], u[1]);
    *reinterpret_cast<float2*>(sums.weight + at) = make_float2(weights[0], weights[1]);
  };
  const auto flush = [&](int first, int count) {
    __syncwarp();
    const int j = lane >> 2;
    const bool active = j < count;
    const int from = first + (active ? j : 0);
    const float4 p = stage.splat[from][0];
    float values[kValues];
    sum_splat<kDepth>(sums, grads[pixels.quarter], active ? j : 0, q, middle_x - p.x,
                      middle_y - p.y, values);
    if (active) {
      float* out;
      if (slots) {
        const int64_t slot = (int64_t(list.begin) + stage.position[from]) * 4 + pixels.quarter;
        out = gradients.slots + slot * kValues;
        for (int k = 0; k < 2; ++k) out[2 * q + k] = values[k];
        for (int k = 8; k < kValues; ++k) {
          if (q == k - 8) out[k] = values[k];
        }
        progress = stage.position[first + count - 1] + 1;
      } else {
        out = view_sums + int64_t(stage.entry[from] >> kMaskBits) * kValues;
        for (int k = 0; k < 2; ++k) atomicAdd(out + 2 * q + k, values[k]);
        for (int k = 8; k < kValues; ++k) {
          if (q == k - 8) atomicAdd(out + k, values[k]);
        }
      }
    }
    __syncwarp();
  };
  stream_tile(
      call, pixels, stage, round, reinterpret_cast<uint64_t*>(all_sums),
      [&] { return any_alive(t); },
      [&](int begin, int end) {
        for_group<4>(begin, end, blend);
        flush(begin, end - begin);
      },
      [](const uint32_t*, int) {});
  if (slots && lane == 0) gradients.progress[global_tile * 4 + pixels.quarter] = progress;
}

// ---- deterministic gather ---------------------------------------------------------------------

/// Position of a Gaussian in a sorted list that contains it.
__device__ __forceinline__ uint32_t find_in_list(const uint32_t* entries, uint32_t count,
                                                 const Splat* splats, float depth, uint32_t index) {
  uint32_t low = 0, high = count - 1;
  while (low < high) {
    const uint32_t middle = (low + high) / 2, other = entries[middle] >> kMaskBits;
    const float other_depth = splats[other].depth;
    const bool before = other_depth < depth || (other_depth == depth && other < index);
    low = before ? middle + 1 : low;
    high = before ? high : middle;
  }
  return low;
}

constexpr int kGatherThreads = 128;

template <bool kDepth>
__global__ void __launch_bounds__(kGatherThreads)
    gather_kernel(const __grid_constant__ RenderCall call,
                  const __grid_constant__ Gradients gradients) {
  constexpr int kValues = m::kPixelSums + kDepth;
  const int index = blockIdx.x * kGatherThreads + threadIdx.x, view = blockIdx.y;
  if (index >= call.count) return;
  const Splat* const splats = call.splats + int64_t(view) * call.count;
  const Splat splat = load_splat(splats + index);
  if (!(splat.depth > 0)) return;
  float sums[kValues] = {};
  const Ellipse ellipse(splat);
  int lo, hi;
  ellipse.rows(call.tiles_y - 1, &lo, &hi);
  walk_rows(ellipse, lo, hi, call, [&](int tile, uint32_t) {
    const int64_t global_tile = int64_t(view) * call.tiles + tile;
    const TileList list = call.tile_list[global_tile];
    if (list.begin >= call.capacity) return;
    const auto* const entries = reinterpret_cast<const uint32_t*>(call.keys + list.begin);
    const uint32_t at = find_in_list(entries, list.count, splats, splat.depth, index);
    for (int quarter = 0; quarter < 4; ++quarter) {
      if ((entries[at] >> quarter & 1) == 0) continue;  // the adjoint skipped it
      if (at >= gradients.progress[global_tile * 4 + quarter]) continue;
      const float* const slot =
          gradients.slots + ((int64_t(list.begin) + at) * 4 + quarter) * kValues;
      for (int k = 0; k < kValues; ++k) sums[k] += slot[k];
    }
  });
  float* const out = gradients.sums + (int64_t(view) * call.count + index) * kValues;
  for (int k = 0; k < kValues; ++k) out[k] += sums[k];
}

/// Calls run(std::bool_constant flag).
template <class Run>
void with_flag(bool flag, const Run& run) {
  if (flag) {
    run(std::true_type());
  } else {
    run(std::false_type());
  }
}

}  // namespace

void launch_blend(const RenderCall& call, const Images& images, const Clearing& clearing,
                  cudaStream_t stream) {
  const int blocks = call.views * call.tiles;
  with_flag(images.depth_sum != nullptr, [&](auto depth) {
    with_flag(clearing.memory != nullptr, [&](auto keep) {
      constexpr bool kDepth = decltype(depth)::value, kGradient = decltype(keep)::value;
      blend_kernel<kDepth, kGradient><<<blocks, kBlendThreads, 0, stream>>>(call, images, clearing);
    });
  });
}

void launch_blend_adjoint(const RenderCall& call, const ImageGradients& images,
                          const Gradients& gradients, cudaStream_t stream) {
  const int blocks = call.views * call.tiles;
  with_flag(gradients.with_depth, [&](auto depth) {
    with_flag(gradients.slots != nullptr, [&](auto slots) {
      constexpr bool kDepth = decltype(depth)::value, kSlots = decltype(slots)::value;
      blend_adjoint_kernel<kDepth, kSlots>
          <<<blocks, kBlendThreads, 0, stream>>>(call, images, gradients);
    });
  });
}

void launch_gather(const RenderCall& call, const Gradients& gradients, cudaStream_t stream) {
  if (call.count == 0) return;
  const dim3 blocks((call.count + kGatherThreads - 1) / kGatherThreads, call.views);
  with_flag(gradients.with_depth, [&](auto depth) {
    gather_kernel<decltype(depth)::value><<<blocks, kGatherThreads, 0, stream>>>(call, gradients);
  });
}

}  // namespace jade::splat::cuda
