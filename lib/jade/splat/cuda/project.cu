// SPDX-License-Identifier: Apache-2.0
// A Gaussian per thread: projects it into every view, or gathers its gradient from every view.
#include <type_traits>

#include "jade/splat/cuda/gaussian_block.cuh"
#include "jade/splat/cuda/launch.h"
#include "jade/splat/cuda/warp.cuh"
#include "jade/splat/math/view.h"

namespace jade::splat::cuda {

namespace {

constexpr int kProjectGaussians = 64;
/// Threads that share a Gaussian's views, so that few Gaussians fill the GPU.
constexpr int kViewGroups = 3;
constexpr int kProjectThreads = kProjectGaussians * kViewGroups;

/// True if some pixel centre i + ½ with 0 ≤ i < size lies in center ± half.
__device__ __forceinline__ bool reaches_pixels(float center, float half, int size) {
  const float low = fmaxf(ceilf(center - half - 0.5f), 0.0f);
  return low <= fminf(floorf(center + half - 0.5f), float(size - 1));
}

template <int kDegree>
__device__ __forceinline__ Splat make_splat(const RenderCall& call, const m::Shape<float>& shape,
                                            const m::Camera<float>& camera, const float* sh) {
  Splat splat{};
  const m::Screen<float> screen = m::project(shape, camera, call.antialiased);
  if (!m::is_drawable(screen, call.near_plane)) return splat;
  const float log2_opacity = m::log2(screen.opacity);
  const float reach = m::reach(log2_opacity);
  if (!(reach > 0.0f)) return splat;
  const float half_x = m::half_extent(reach, screen.cov_xx);
  const float half_y = m::half_extent(reach, screen.cov_yy);
  if (!reaches_pixels(screen.x, half_x, call.width)) return splat;
  if (!reaches_pixels(screen.y, half_y, call.height)) return splat;
  float color[3];
  m::view_color(kDegree, shape.mean, camera, sh, color);
  for (int c = 0; c < 3; ++c) {
    if (!m::within(color[c], float(m::kMaxColor))) return splat;
  }
  const auto falloff = m::make_falloff(screen.cov_xx, screen.cov_xy, screen.cov_yy, screen.det);
  const auto row = m::make_row_extent(reach, screen.cov_xy, screen.cov_yy, screen.det);
  return {screen.x, screen.y, falloff.a, falloff.b,    falloff.c, log2_opacity,
          color[0], color[1], color[2],  screen.depth, row.slope, row.shrink};
}

/// A warp's records of one view, on their way to memory in whole sectors.
struct SplatStage {
  float4 parts[3 * 32];
};

/// Writes the splats of Gaussians first … first + 31 of a view, a lane each.
__device__ __forceinline__ void store_splats(const RenderCall& call, int view, int first,
                                             const Splat& splat, SplatStage& stage) {
  const int lane = threadIdx.x & 31, parts = 3 * min(32, call.count - first);
  __syncwarp();
  for (int k = 0; k < 3; ++k) {
    stage.parts[3 * lane + k] = reinterpret_cast<const float4*>(&splat)[k];
  }
  __syncwarp();
  float4* const out = reinterpret_cast<float4*>(call.splats + int64_t(view) * call.count + first);
  for (int k = 0; k < 3; ++k) {
    const int i = 32 * k + lane;
    if (i < parts) out[i] = stage.parts[i];
  }
}

/// kCount: counts the tiles' instances too.
template <int kDegree, bool kCount>
__global__ void __launch_bounds__(kProjectThreads, kCount ? 4 : 5)
    project_kernel(const __grid_constant__ RenderCall call) {
  __shared__ float sh_rows[kProjectGaussians * kShRow];
  __shared__ m::Camera<float> cameras[kCameraChunk];
  __shared__ SplatStage stages[kProjectThreads / 32];
  const int first = blockIdx.x * kProjectGaussians, row = threadIdx.x % kProjectGaussians;
  const int index = first + row, group = threadIdx.x / kProjectGaussians;
  stage_sh(call, first, kProjectGaussians, 3 * m::sh_count(kDegree), sh_rows);
  __syncthreads();
  const float* const sh = sh_rows + row * kShRow;
  m::RawShape<float> raw{};
  const bool usable = load_gaussian<kDegree>(call, index, sh, &raw);
  if (!usable && index < call.count && group == 0) atomicAdd(&call.counters->rejected, 1ull);
  const m::Shape<float> shape = m::activate(raw);
  for (int chunk = 0; chunk < call.views; chunk += kCameraChunk) {
    const int length = min(kCameraChunk, call.views - chunk);
    __syncthreads();
    stage_cameras(call, chunk, cameras);
    __syncthreads();
    for (int step = group; step < length; step += kViewGroups) {
      // Blocks start at different views, so that their atomics meet on fewer counters.
      const int in_chunk = kCount ? (step + int(blockIdx.x)) % length : step;
      const int view = chunk + in_chunk;
      Splat splat{};
      if (usable) splat = make_splat<kDegree>(call, shape, cameras[in_chunk], sh);
      store_splats(call, view, first + (row & ~31), splat, stages[threadIdx.x / 32]);
      if (kCount) {
        TileList* const lists = call.tile_list + view * call.tiles;
        walk_tiles(splat, splat.depth > 0, index, call,
                   [&](float, int, int tile, uint32_t) { atomicAdd(&lists[tile].count, 1u); });
      }
    }
  }
}

// ---- adjoint ----------------------------------------------------------------------------------

struct Statistics {
  float norm = 0, visible = 0, radius = 0;
};

/// A splat with the sums over its view's pixels.
template <bool kDepth>
__device__ __forceinline__ m::Drawn<float> load_drawn(const Splat& splat, const float* sums) {
  m::Drawn<float> drawn;
  drawn.visible = true;
  drawn.falloff = {splat.a, splat.b, splat.c};
  drawn.color[0] = splat.red;
  drawn.color[1] = splat.green;
  drawn.color[2] = splat.blue;
  m::set_sums(sums, kDepth, &drawn);
  return drawn;
}

__device__ __forceinline__ void add_statistics(const RenderCall& call, const m::Shape<float>& shape,
                                               const m::Camera<float>& camera,
                                               const m::ScreenGradient<float>& on_screen,
                                               Statistics* statistics) {
  statistics->norm += m::ndc_gradient_norm(on_screen, call.width, call.height);
  statistics->visible += 1;
  statistics->radius = fmaxf(statistics->radius, m::screen_radius(shape, camera));
}

/// Sums the warps' camera gradients and adds them to the view's, or keeps them for finish().
__device__ __forceinline__ void add_camera(const RenderCall& call, const Gradients& gradients,
                                           int view, const m::CameraGradient<float>& on_camera,
                                           float (*warp_sums)[2][12]) {
  float values[16];
  for (int k = 0; k < 9; ++k) values[k] = on_camera.rotation[k];
  for (int k = 0; k < 3; ++k) values[9 + k] = on_camera.translation[k];
  for (int k = 12; k < 16; ++k) values[k] = 0;
  const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5, parity = view & 1;
  const float sum = sum_sixteen(values, lane);
  if ((lane & 1) == 0 && lane < 24) warp_sums[parity][warp][lane / 2] = sum;
  __syncthreads();  // the other parity keeps the next view's writes apart from these reads
  if (threadIdx.x < 12) {
    const float total = warp_sums[parity][0][threadIdx.x] + warp_sums[parity][1][threadIdx.x];
    const int64_t element = int64_t(view) * 12 + threadIdx.x;
    if (gradients.camera_partial != nullptr) {
      gradients.camera_partial[int64_t(blockIdx.x) * call.views * 12 + element] = total;
    } else {
      atomicAdd(gradients.camera_sums + element, total);
    }
  }
}

/// Runs in the last block: camera and background gradients in their final shape.
__device__ void finish(const RenderCall& call, const Gradients& gradients) {
  for (int i = threadIdx.x; i < call.views * 16 && gradients.camera_from_world != nullptr;
       i += blockDim.x) {
    const int view = i / 16, row = i % 16 / 4, column = i % 4;
    float value = 0;
    if (row < 3) {
      const int64_t element = view * 12 + (column < 3 ? 3 * row + column : 9 + row);
      if (gradients.camera_partial != nullptr) {
        double sum = 0;
        for (int block = 0; block < gridDim.x; ++block) {
          sum += __ldcg(gradients.camera_partial + int64_t(block) * call.views * 12 + element);
        }
        value = float(sum);
      } else {
        value = __ldcg(gradients.camera_sums + element);
      }
    }
    gradients.camera_from_world[i] = value;
  }
  if (threadIdx.x < 3) {
    float value = 0;
    if (gradients.background_partial != nullptr) {
      double sum = 0;
      for (int64_t tile = 0; tile < int64_t(call.views) * call.tiles; ++tile) {
        sum += __ldcg(gradients.background_partial + 3 * tile + threadIdx.x);
      }
      value = float(sum);
    } else {
      value = __ldcg(gradients.background_sums + threadIdx.x);
    }
    gradients.background[threadIdx.x] = value;
  }
}

/// Blocks per multiprocessor, as many as their shared memory leaves room for on an H200: without
/// the bound some of the kernels take 160 registers, and two blocks less run.
constexpr int kAdjointBlocks = 8;

/// Writes rows of kShRow to [N, sh_stride, 3]; coefficients above the active degree get 0.
__device__ __forceinline__ void store_sh(const RenderCall& call, int first, int used,
                                         const float* rows, float* target) {
  const int width = 3 * call.sh_stride;
  const int count = min(int(blockDim.x), call.count - first);
  float* const out = target + int64_t(first) * width;
  if (width == 48 && used == 48) {
    for (int i = threadIdx.x; i < count * 12; i += blockDim.x) {
      const float* const in = rows + (i / 12) * kShRow + (i % 12) * 4;
      reinterpret_cast<float4*>(out)[i] = make_float4(in[0], in[1], in[2], in[3]);
    }
    return;
  }
  for (int i = threadIdx.x; i < count * width; i += blockDim.x) {
    const int column = i % width;
    out[i] = column < used ? rows[(i / width) * kShRow + column] : 0.0f;
  }
}

template <int kDegree, bool kDepth>
__global__ void __launch_bounds__(kAdjointThreads, kAdjointBlocks)
    project_adjoint_kernel(const __grid_constant__ RenderCall call,
                           const __grid_constant__ Gradients gradients) {
  constexpr int kUsed = 3 * m::sh_count(kDegree);
  __shared__ float sh_rows[kAdjointThreads * kShRow], grad_rows[kAdjointThreads * kShRow];
  __shared__ m::Camera<float> cameras[kCameraChunk];
  __shared__ float warp_sums[2][kAdjointThreads / 32][12];
  __shared__ bool last_block;
  const int first = blockIdx.x * kAdjointThreads, index = first + threadIdx.x;
  stage_sh(call, first, kAdjointThreads, kUsed, sh_rows);
  for (int i = threadIdx.x; i < kAdjointThreads * kShRow; i += kAdjointThreads) grad_rows[i] = 0;
  __syncthreads();
  const float* const sh = sh_rows + threadIdx.x * kShRow;
  float* const grad_sh = grad_rows + threadIdx.x * kShRow;
  m::RawShape<float> raw{};
  load_gaussian<kDegree>(call, index, sh, &raw);
  const m::Shape<float> shape = m::activate(raw);
  m::ShapeGradient<float> on_shape{};
  Statistics statistics;
  for (int view = 0; view < call.views; ++view) {
    if (view % kCameraChunk == 0) {
      __syncthreads();
      stage_cameras(call, view, cameras);
      __syncthreads();
    }
    m::CameraGradient<float> on_camera{};
    const int64_t slot = int64_t(view) * call.count + index;
    if (index < call.count) {
      const Splat splat = load_splat(call.splats + slot);
      if (splat.depth > 0) {
        const m::Camera<float>& camera = cameras[view % kCameraChunk];
        const m::ScreenGradient<float> on_screen = m::view_adjoint(
            {camera, kDegree, call.antialiased}, shape, sh,
            load_drawn<kDepth>(splat, gradients.sums + slot * (m::kPixelSums + kDepth)), &on_shape,
            grad_sh, &on_camera);
        const bool counts = gradients.statistics_view < 0 || gradients.statistics_view == view;
        if (gradients.gradient_norm != nullptr && counts) {
          add_statistics(call, shape, camera, on_screen, &statistics);
        }
      }
    }
    if (gradients.camera_from_world != nullptr) {
      add_camera(call, gradients, view, on_camera, warp_sums);
    }
  }
  if (index < call.count) {
    const m::RawShape<float> grad = m::activate_adjoint(raw, shape, on_shape);
    for (int k = 0; k < 3; ++k) gradients.means[3ll * index + k] = grad.mean[k];
    for (int k = 0; k < 4; ++k) gradients.rotations[4ll * index + k] = grad.quaternion[k];
    for (int k = 0; k < 3; ++k) gradients.log_scales[3ll * index + k] = grad.log_scale[k];
    gradients.logit_opacities[index] = grad.logit_opacity;
    if (gradients.gradient_norm != nullptr) {
      gradients.gradient_norm[index] += statistics.norm;
      gradients.visible_count[index] += statistics.visible;
      gradients.max_radius_px[index] = fmaxf(gradients.max_radius_px[index], statistics.radius);
    }
  }
  __syncthreads();
  store_sh(call, first, kUsed, grad_rows, gradients.sh);
  __threadfence();
  __syncthreads();
  if (threadIdx.x == 0) last_block = atomicAdd(gradients.done_blocks, 1u) == gridDim.x - 1;
  __syncthreads();
  if (last_block) finish(call, gradients);
}

}  // namespace

void launch_project(const RenderCall& call, cudaStream_t stream) {
  const int blocks = (call.count + kProjectGaussians - 1) / kProjectGaussians;
  if (blocks == 0) return;
  with_degree(call.sh_degree, [&](auto degree) {
    constexpr int kDegree = decltype(degree)::value;
    if (call.chunks > 0) {
      project_kernel<kDegree, false><<<blocks, kProjectThreads, 0, stream>>>(call);
    } else {
      project_kernel<kDegree, true><<<blocks, kProjectThreads, 0, stream>>>(call);
    }
  });
}

void launch_project_adjoint(const RenderCall& call, const Gradients& gradients,
                            cudaStream_t stream) {
  const int blocks = max(1, (call.count + kAdjointThreads - 1) / kAdjointThreads);
  with_degree(call.sh_degree, [&](auto degree) {
    constexpr int kDegree = decltype(degree)::value;
    if (gradients.with_depth) {
      project_adjoint_kernel<kDegree, true>
          <<<blocks, kAdjointThreads, 0, stream>>>(call, gradients);
    } else {
      project_adjoint_kernel<kDegree, false>
          <<<blocks, kAdjointThreads, 0, stream>>>(call, gradients);
    }
  });
}

}  // namespace jade::splat::cuda
