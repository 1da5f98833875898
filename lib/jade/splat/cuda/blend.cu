// SPDX-License-Identifier: Apache-2.0
// Blending and its adjoint: one block per tile, one warp per quarter of it, one lane per two
// pixels, or per one pixel late in a list of the forward pass.
#include "jade/kernel/tensor_core.cuh"
#include "jade/splat/cuda/blend.cuh"
#include "jade/splat/cuda/launch.h"
#include "jade/splat/cuda/warp.cuh"

namespace jade::splat::cuda {

namespace {

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

  /// Blends a splat into pixel k: math::blend_step().
  /// @param color  red, green, blue, and anything
  template <bool kDepth, bool kCapped>
  __device__ __forceinline__ void add(int k, float exponent, float max_alpha, const float4& color,
                                      float splat_depth) {
#ifdef __CUDACC__
    float alpha = FastArithmetic::exp2(exponent);
    if (kCapped) alpha = FastArithmetic::cap(alpha, max_alpha);
    const float used = FastArithmetic::product(alpha, t[k]), left = t[k] - used;
    // The compiler would choose between α and 0 first. Here a splat that is not visible changes
    // nothing instead, and sums change only where the pixel also goes on.
    asm("{ .reg .pred visible, goes_on;\n"
        "setp.ge.f32 visible, %4, %11;\n"
        "setp.gt.and.f32 goes_on, %5, %12, visible;\n"
        "@visible selp.f32 %0, %5, %6, goes_on;\n"
        "@goes_on fma.rn.f32 %1, %7, %8, %1;\n"
        "@goes_on fma.rn.f32 %2, %7, %9, %2;\n"
        "@goes_on fma.rn.f32 %3, %7, %10, %3; }"
        : "+f"(t[k]), "+f"(red[k]), "+f"(green[k]), "+f"(blue[k])
        : "f"(exponent), "f"(left), "f"(m::make_negative(t[k])), "f"(used), "f"(color.x),
          "f"(color.y), "f"(color.z), "f"(float(m::kLog2MinAlpha)),
          "f"(float(m::kMinTransmittance)));
    const bool goes_on = m::is_visible(exponent) && left > float(m::kMinTransmittance);
    if (kDepth && goes_on) depth[k] = fmaf(used, splat_depth, depth[k]);
#else  // tests/emulated
    const auto step = m::blend_step<FastArithmetic, false, kCapped>(exponent, max_alpha, &t[k]);
    red[k] = fmaf(step.weight, color.x, red[k]);
    green[k] = fmaf(step.weight, color.y, green[k]);
    blue[k] = fmaf(step.weight, color.z, blue[k]);
    if (kDepth) depth[k] = fmaf(step.weight, splat_depth, depth[k]);
#endif
  }
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
__global__ void __launch_bounds__(kBlendThreads, kBlendBlocks - kDepth)
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
  float px = from_middle(place % kSubtile);
  int line = place / kSubtile;
  PixelSums s;
  for (int k = 0; k < 2; ++k) s.t[k] = pixels.inside[k] ? 1.0f : -1.0f;  // negative: stopped
  const auto blend = [&](int j, auto count, auto capped) {
    const float4 color = stage.splat[j].color_a;
    const m::RowFalloff<float> row = stage.splat[j].falloff(line);
#pragma unroll
    for (int k = 0; k < decltype(count)::value; ++k) {
      s.add<kDepth, decltype(capped)::value>(k, m::exponent(row, px + float(k)), call.max_alpha,
                                             color, stage.depth[j]);
    }
  };
  bool narrow = false;    // one pixel per lane
  uint32_t changing = 0;  // bit j: splat j of the stage changed this lane's pixel
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
    px = from_middle(one.place() % kSubtile);
    line = one.place() / kSubtile;
    place = one.taken() ? one.place() : -1;
    narrow = true;
  };
  stream_tile(
      call, pixels, stage, round, round_keys,
      [&] { return __any_sync(~0u, s.t[0] > 0 || s.t[1] > 0); },
      [&](int begin, int end, bool capped) {
        if (narrow) {
          uint32_t of_group = 0;
          for_group<1, kGroup>(begin, end, capped, [&](int j, int in_group, auto cap) {
            const float before = s.t[0];
            blend(j, std::integral_constant<int, 1>(), cap);
            if (kGradient && s.t[0] != before) of_group |= 1u << in_group;
          });
          changing |= of_group << begin;
        } else {
          for_group<1, kGroup / 2>(begin, end, capped, [&](int j, int, auto cap) {
            blend(j, std::integral_constant<int, 2>(), cap);
          });
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

/// dL/dpixel, and `behind` and `bound` of math/blend.h, for one lane.
struct PixelGradients {
  float red[2], green[2], blue[2], depth[2], behind[2];
  float bound[2];  ///< above 1 outside the image, where no pixel goes on
};

/// A factor of dL/dpixel, in which the adjoint's sums are linear. Their terms are cut to TF32
/// (SumFactors), which loses 2^-12 / ln 2 of a term on average, if the logarithms of terms are
/// evenly spread. The factor restores this mean, so that gradients are not shorter.
constexpr float kRestoredMean = 1.0f + 0x1p-12f * float(m::kLog2E);

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
    g.bound[k] = 2;
    if (!pixels.inside[k]) continue;
    const int64_t i = pixels.offset[k];
    const float t_end = 1.0f - images.alpha[alpha_at + i];
    g.bound[k] = m::replay_bound(images.alpha[alpha_at + i]);
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
    for (float* const value : {&g.red[k], &g.green[k], &g.blue[k], &g.depth[k], &g.behind[k]}) {
      *value *= kRestoredMean;
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

/// Sums over a splat's pixels on the tensor cores. D += A · B with
///     A [16, 8]  value of splat m / 8 of a pair, in row m % 8 of the quarter, at k
///     B [8, 8]   factor of the value at k in sum n
///     D [16, 8]  sum n of splat m / 8 over the row m % 8.
/// A lane's pixels lie in row g = lane / 4, columns 2 t and 2 t + 1, t = lane % 4. Of A a lane
/// holds the elements (g, t), (g + 8, t), (g, t + 4), (g + 8, t + 4): if k stands for column 2 k,
/// or from 4 on for 2 (k − 4) + 1, these are its two pixels for both splats, so values go from
/// registers to the tensor cores. Of D it gets sums 2 t and 2 t + 1 of row g for both splats.
///
/// Three products add up to one D: of u, for its moments along the row; of a lane's contributions
/// to dL/dred (k < 4) and dL/dgreen (k ≥ 4); and of those to dL/dblue and dL/ddepth, or, without
/// depth, of each pixel's contribution to dL/dblue. Sums n are
///     u, blue, u x, depth or 0, u x², red, 0, green         (x from the quarter's middle)
/// so that each of the four lanes that later share a splat adds up two sums (sum_rows()).
struct SumFactors {
  float moments[2], red_green[2], blue_depth[2];  ///< this lane's elements of each B

  __device__ __forceinline__ SumFactors(int lane, bool depth) {
    const int n = lane >> 2;
    for (int i = 0; i < 2; ++i) {
      const float x = from_middle(2 * (lane & 3) + i);
      moments[i] = n == 0 ? 1.0f : n == 2 ? x : n == 4 ? x * x : 0.0f;
      red_green[i] = n == 5 + 2 * i ? 1.0f : 0.0f;
      blue_depth[i] = n == (depth ? 1 + 2 * i : 1) ? 1.0f : 0.0f;
    }
  }
};

constexpr int kAdjointBlocks = 7;               ///< per multiprocessor
constexpr int kPairsAtOnce = 4;                 ///< of splats, in an unrolled loop
constexpr int kSplatStride = 8 * kSubtile + 8;  ///< avoids bank conflicts of sum_rows()

/// Shared memory of a warp. One struct, so that one register addresses both parts.
struct alignas(16) WarpAdjoint {
  WarpStage stage;
  float sums[kGroup * kSplatStride];  ///< over the rows of a group's splats: [splat][row][n]
};

/// Four lanes share a splat: lane q of them adds up sums 2 q and 2 q + 1 of all rows. Afterwards
/// its values[i] is number q + 4 i of the splat's kPixelSums (+ 1).
__device__ __forceinline__ void sum_rows(const float* sums, int splat, int q, float dx, float dy,
                                         float* values) {
  float s0 = 0, sy = 0, syy = 0, color = 0;  // of the even sum: moments along y; of the odd one
#pragma unroll
  for (int row = 0; row < kSubtile; ++row) {
    const float2 v =
        *reinterpret_cast<const float2*>(sums + splat * kSplatStride + row * kSubtile + 2 * q);
    const float y = from_middle(row);
    s0 += v.x;
    sy += y * v.x;
    syy += y * y * v.x;
    color += v.y;
  }
  const int first = threadIdx.x & 28;  // of the splat's lanes
  const float m0 = __shfl_sync(~0u, s0, first), mx = __shfl_sync(~0u, s0, first + 1);
  const float mxx = __shfl_sync(~0u, s0, first + 2), my = __shfl_sync(~0u, sy, first);
  const float mxy = __shfl_sync(~0u, sy, first + 1), myy = __shfl_sync(~0u, syy, first);
  // From moments about the quarter's middle to those about the splat.
  const float x1 = mx + dx * m0, y1 = my + dy * m0;
  const float xx = mxx + dx * (mx + x1), yy = myy + dy * (my + y1), xy = mxy + dx * y1 + dy * mx;
  values[0] = q == 0 ? m0 : q == 1 ? x1 : q == 2 ? y1 : xx;
  values[1] = q == 0 ? xy : q == 1 ? yy : color;  // red, green
  values[2] = color;                              // blue, depth
}

template <bool kDepth, bool kSlots>
__global__ void __launch_bounds__(kBlendThreads, kAdjointBlocks - (kDepth && kSlots))
    blend_adjoint_kernel(const __grid_constant__ RenderCall call,
                         const __grid_constant__ ImageGradients images,
                         const __grid_constant__ Gradients gradients) {
  constexpr int kValues = m::kPixelSums + kDepth;
  __shared__ WarpAdjoint warps[kBlendThreads / 32];
  static_assert(sizeof(warps) >= kRoundKeys * sizeof(uint64_t), "rounds borrow this memory");
  __shared__ RoundShared round;
  __shared__ float warp_background[kBlendThreads / 32][3];
  const Pixels pixels(call);
  WarpStage& stage = warps[pixels.quarter].stage;
  float* const sums = warps[pixels.quarter].sums;
  const int lane = threadIdx.x & 31;
  float background[3];
  PixelGradients g = load_gradients<kDepth>(call, pixels, images, background);
  if (gradients.background != nullptr) {
    add_background(call, pixels, gradients, background, warp_background);
  }

  const float px = from_middle(2 * (lane & 3));
  float t[2] = {1, 1};
  const int64_t global_tile = int64_t(pixels.view) * call.tiles + pixels.tile;
  const TileList list = call.tile_list[global_tile];
  const bool slots = kSlots && list.begin < call.capacity;
  float* const lane_sums =
      gradients.sums + int64_t(pixels.view) * call.count * kValues + (lane & 3);
  const SumFactors factors(lane, kDepth);
  uint32_t progress = 0;
  const auto blend_pair = [&](int j, int in_group, auto capped) {
    constexpr bool kCapped = decltype(capped)::value;
    float u[4], red_green[4], blue_depth[4], d[4] = {0, 0, 0, 0};
#pragma unroll
    for (int i = 0; i < 2; ++i) {
      const float4 color = stage.splat[j + i].color_a;
      const m::RowFalloff<float> row = stage.splat[j + i].falloff(lane >> 2);
      float weights[2];
#pragma unroll
      for (int k = 0; k < 2; ++k) {
        const auto step = m::replay_step<FastArithmetic, kCapped>(
            m::exponent(row, px + float(k)), call.max_alpha, g.bound[k], &t[k]);
        float value = g.red[k] * color.x + g.green[k] * color.y + g.blue[k] * color.z;
        if (kDepth) value += g.depth[k] * stage.depth[j + i];
        u[2 * k + i] = m::blend_step_adjoint<FastArithmetic, false, kCapped>(
            step, value, call.max_alpha, &g.behind[k]);
        weights[k] = step.weight;
      }
      const auto both = [&](const float* grad) {
        return weights[0] * grad[0] + weights[1] * grad[1];
      };
      red_green[i] = both(g.red);
      red_green[2 + i] = both(g.green);
      blue_depth[i] = kDepth ? both(g.blue) : weights[0] * g.blue[0];
      blue_depth[2 + i] = kDepth ? both(g.depth) : weights[1] * g.blue[1];
    }
    kernel::multiply_add_tf32(d, u, factors.moments);
    kernel::multiply_add_tf32(d, red_green, factors.red_green);
    kernel::multiply_add_tf32(d, blue_depth, factors.blue_depth);
    float* const to = sums + in_group * kSplatStride + 2 * lane;  // row lane / 4, n = 2 (lane % 4)
    *reinterpret_cast<float2*>(to) = make_float2(d[0], d[1]);
    *reinterpret_cast<float2*>(to + kSplatStride) = make_float2(d[2], d[3]);
  };
  const auto flush = [&](int first, int count) {
    __syncwarp();
    const int j = lane >> 2, q = lane & 3;
    const float2 offset = stage.offset[first + j];
    float values[3];
    sum_rows(sums, j, q, offset.x, offset.y, values);
    if (j < count) {
      float* out = lane_sums + int64_t(stage.entry[first + j] >> kMaskBits) * kValues;
      if (slots) {
        const int64_t slot = (int64_t(list.begin) + stage.position[first + j]) * 4 + pixels.quarter;
        out = gradients.slots + slot * kValues + q;
        progress = stage.position[first + count - 1] + 1;
      }
      for (int i = 0; i < 3; ++i) {
        if (i == 2 && q + 8 >= kValues) continue;
        if (slots) {
          out[4 * i] = values[i];
        } else {
          atomicAdd(out + 4 * i, values[i]);
        }
      }
    }
    __syncwarp();
  };
  stream_tile(
      call, pixels, stage, round, reinterpret_cast<uint64_t*>(warps),
      [&] { return __any_sync(~0u, t[0] > g.bound[0] || t[1] > g.bound[1]); },
      [&](int begin, int end, bool capped) {
        for_group<2, kPairsAtOnce>(begin, end, capped, blend_pair);
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
