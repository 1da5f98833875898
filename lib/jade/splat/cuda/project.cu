// SPDX-License-Identifier: Apache-2.0
// One thread a Gaussian: projects it into every view, or gathers its gradient from every view.
#include <type_traits>

#include "jade/splat/cuda/gaussian_block.cuh"
#include "jade/splat/cuda/launch.h"
#include "jade/splat/cuda/warp.cuh"

namespace jade::splat::cuda {

namespace {

constexpr float kMaxColor = 1e30f;  ///< a brighter splat is culled
constexpr int kProjectGaussians = 64;
constexpr int kViewGroups =
    3;  ///< threads that share a Gaussian's views: small scenes fill the GPU
constexpr int kProjectThreads = kProjectGaussians * kViewGroups;

/// True if some pixel centre i + ½ with 0 ≤ i < size lies in center ± half.
__device__ __forceinline__ bool reaches_pixels(float center, float half, int size) {
  const float low = fmaxf(ceilf(center - half - 0.5f), 0.0f);
  return low <= fminf(floorf(center + half - 0.5f), float(size - 1));
}

template <int kDegree>
__device__ __forceinline__ Splat make_splat(const Scene& scene, const m::Shape<float>& shape,
                                            const m::Camera<float>& camera, const float* sh) {
  Splat splat{};
  const m::Screen<float> screen = m::project(shape, camera, scene.antialiased);
  if (!m::is_drawable(screen, scene.near_plane)) return splat;
  const float log2_opacity = m::log2(screen.opacity);
  const float reach = m::reach(log2_opacity);
  if (!(reach > 0.0f)) return splat;
  float half_x, half_y;
  m::half_extents(reach, screen.cov_xx, screen.cov_yy, &half_x, &half_y);
  if (!reaches_pixels(screen.x, half_x, scene.width)) return splat;
  if (!reaches_pixels(screen.y, half_y, scene.height)) return splat;
  float direction[3], basis[16], color[3];
  m::view_direction(shape.mean, camera, direction);
  m::sh_basis(kDegree, direction, basis);
  m::sh_color(kDegree, basis, sh, color);
  for (int c = 0; c < 3; ++c) {
    if (!m::within(color[c], kMaxColor)) return splat;
  }
  const auto falloff = m::make_falloff(screen.cov_xx, screen.cov_xy, screen.cov_yy, screen.det);
  const auto row = m::make_row_extent(reach, screen.cov_xy, screen.cov_yy, screen.det);
  return {screen.x, screen.y, falloff.a, falloff.b,    falloff.c, log2_opacity,
          color[0], color[1], color[2],  screen.depth, row.slope, row.shrink};
}

template <int kDegree>
__global__ void __launch_bounds__(kProjectThreads)
    project_kernel(const __grid_constant__ Scene scene) {
  __shared__ float sh_rows[kProjectGaussians * kShRow];
  __shared__ m::Camera<float> cameras[kCameraChunk];
  const int first = blockIdx.x * kProjectGaussians, row = threadIdx.x % kProjectGaussians;
  const int index = first + row, group = threadIdx.x / kProjectGaussians;
  stage_sh(scene, first, kProjectGaussians, 3 * m::sh_count(kDegree), sh_rows);
  __syncthreads();
  const float* const sh = sh_rows + row * kShRow;
  m::RawShape<float> raw;
  const bool usable = load_gaussian<kDegree>(scene, index, sh, &raw);
  if (!usable && index < scene.count && group == 0) atomicAdd(&scene.counters->rejected, 1ull);
  const m::Shape<float> shape = m::activate(raw);
  for (int chunk = 0; chunk < scene.views; chunk += kCameraChunk) {
    const int length = min(kCameraChunk, scene.views - chunk);
    __syncthreads();
    stage_cameras(scene, chunk, cameras);
    __syncthreads();
    for (int step = group; step < length; step += kViewGroups) {
      // Blocks start at different views, so that their atomics meet on fewer counters.
      const int in_chunk = (step + int(blockIdx.x)) % length, view = chunk + in_chunk;
      Splat splat{};
      if (usable) splat = make_splat<kDegree>(scene, shape, cameras[in_chunk], sh);
      if (index < scene.count) {
        float4* const out =
            reinterpret_cast<float4*>(scene.splats + int64_t(view) * scene.count + index);
        for (int k = 0; k < 3; ++k) out[k] = reinterpret_cast<const float4*>(&splat)[k];
      }
      TileList* const lists = scene.tile_list + view * scene.tiles;
      walk_tiles(splat, splat.depth > 0, index, scene,
                 [&](float, int, int tile, uint32_t) { atomicAdd(&lists[tile].count, 1u); });
    }
  }
}

// ---- adjoint ----------------------------------------------------------------------------------

struct Statistics {
  float norm = 0, visible = 0, radius = 0;
};

/// One view's part of a Gaussian's gradient.
template <int kDegree, bool kDepth>
__device__ __forceinline__ void view_adjoint(const Scene& scene, const Gradients& gradients,
                                             const m::Shape<float>& shape,
                                             const m::Camera<float>& camera, int64_t slot,
                                             const Splat& splat, const float* sh, float* grad_mean,
                                             float* grad_axes, float* grad_log_opacity,
                                             float* grad_sh, m::CameraGradient<float>* on_camera,
                                             Statistics* statistics) {
  constexpr int kValues = kSums + kDepth;
  float sums[kValues];
  for (int k = 0; k < kValues; ++k) sums[k] = gradients.sums[slot * kValues + k];
  const m::Falloff<float> falloff{splat.a, splat.b, splat.c};
  const m::Moments<float> moments{sums[0], sums[1], sums[2], sums[3], sums[4], sums[5]};
  m::ScreenGradient<float> on_screen;
  m::falloff_adjoint(falloff, moments, &on_screen.x, &on_screen.y, &on_screen.cov_xx,
                     &on_screen.cov_xy, &on_screen.cov_yy);
  on_screen.log_opacity = moments.u;
  on_screen.depth = kDepth ? sums[kValues - 1] : 0.0f;
  *grad_log_opacity += m::project_adjoint(shape, camera, scene.antialiased, on_screen, grad_mean,
                                          grad_axes, on_camera);
  float direction[3], basis[16], grad_basis[16], grad_direction[3] = {0, 0, 0};
  const float inverse_norm = m::view_direction(shape.mean, camera, direction);
  m::sh_basis(kDegree, direction, basis);
  const float color[3] = {splat.red, splat.green, splat.blue};
  m::sh_color_adjoint(kDegree, basis, sh, color, sums + 6, grad_sh, grad_basis);
  m::sh_basis_adjoint(kDegree, direction, grad_basis, grad_direction);
  m::view_direction_adjoint(direction, inverse_norm, grad_direction, camera, grad_mean, on_camera);
  if (gradients.gradient_norm != nullptr) {
    const float gx = on_screen.x * (0.5f * scene.width), gy = on_screen.y * (0.5f * scene.height);
    const m::Screen<float> screen = m::project(shape, camera, false);
    statistics->norm += m::sqrt(gx * gx + gy * gy);
    statistics->visible += 1;
    statistics->radius =
        fmaxf(statistics->radius, m::screen_radius(screen.cov_xx, screen.cov_yy, screen.det));
  }
}

/// Sums the warps' camera gradients and adds them to the view's, or keeps them for finish().
__device__ __forceinline__ void add_camera(const Scene& scene, const Gradients& gradients, int view,
                                           const m::CameraGradient<float>& on_camera,
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
      gradients.camera_partial[int64_t(blockIdx.x) * scene.views * 12 + element] = total;
    } else {
      atomicAdd(gradients.camera_sums + element, total);
    }
  }
}

/// Runs in the last block: camera and background gradients in their final shape.
__device__ void finish(const Scene& scene, const Gradients& gradients) {
  for (int i = threadIdx.x; i < scene.views * 16 && gradients.camera_from_world != nullptr;
       i += blockDim.x) {
    const int view = i / 16, row = i % 16 / 4, column = i % 4;
    float value = 0;
    if (row < 3) {
      const int64_t element = view * 12 + (column < 3 ? 3 * row + column : 9 + row);
      if (gradients.camera_partial != nullptr) {
        double sum = 0;
        for (int block = 0; block < gridDim.x; ++block) {
          sum += __ldcg(gradients.camera_partial + int64_t(block) * scene.views * 12 + element);
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
      for (int64_t tile = 0; tile < int64_t(scene.views) * scene.tiles; ++tile) {
        sum += __ldcg(gradients.background_partial + 3 * tile + threadIdx.x);
      }
      value = float(sum);
    } else {
      value = __ldcg(gradients.background_sums + threadIdx.x);
    }
    gradients.background[threadIdx.x] = value;
  }
}

/// Writes rows of kShRow to [N, sh_stride, 3]; coefficients above the active degree get 0.
__device__ __forceinline__ void store_sh(const Scene& scene, int first, int used, const float* rows,
                                         float* target) {
  const int width = 3 * scene.sh_stride;
  const int count = min(int(blockDim.x), scene.count - first);
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
__global__ void __launch_bounds__(kAdjointThreads)
    project_adjoint_kernel(const __grid_constant__ Scene scene,
                           const __grid_constant__ Gradients gradients) {
  constexpr int kUsed = 3 * m::sh_count(kDegree);
  __shared__ float sh_rows[kAdjointThreads * kShRow], grad_rows[kAdjointThreads * kShRow];
  __shared__ m::Camera<float> cameras[kCameraChunk];
  __shared__ float warp_sums[2][kAdjointThreads / 32][12];
  __shared__ bool last_block;
  const int first = blockIdx.x * kAdjointThreads, index = first + threadIdx.x;
  stage_sh(scene, first, kAdjointThreads, kUsed, sh_rows);
  for (int i = threadIdx.x; i < kAdjointThreads * kShRow; i += kAdjointThreads) grad_rows[i] = 0;
  __syncthreads();
  const float* const sh = sh_rows + threadIdx.x * kShRow;
  float* const grad_sh = grad_rows + threadIdx.x * kShRow;
  m::RawShape<float> raw;
  load_gaussian<kDegree>(scene, index, sh, &raw);
  const m::Shape<float> shape = m::activate(raw);
  float grad_mean[3] = {0, 0, 0}, grad_axes[9] = {0, 0, 0, 0, 0, 0, 0, 0, 0};
  float grad_log_opacity = 0;
  Statistics statistics;
  for (int view = 0; view < scene.views; ++view) {
    if (view % kCameraChunk == 0) {
      __syncthreads();
      stage_cameras(scene, view, cameras);
      __syncthreads();
    }
    m::CameraGradient<float> on_camera{};
    const int64_t slot = int64_t(view) * scene.count + index;
    if (index < scene.count) {
      const Splat splat = load_splat(scene.splats + slot);
      if (splat.depth > 0) {
        Statistics ignored;
        const bool counts = gradients.statistics_view < 0 || gradients.statistics_view == view;
        view_adjoint<kDegree, kDepth>(scene, gradients, shape, cameras[view % kCameraChunk], slot,
                                      splat, sh, grad_mean, grad_axes, &grad_log_opacity, grad_sh,
                                      &on_camera, counts ? &statistics : &ignored);
      }
    }
    if (gradients.camera_from_world != nullptr) {
      add_camera(scene, gradients, view, on_camera, warp_sums);
    }
  }
  if (index < scene.count) {
    const m::RawShape<float> grad =
        m::activate_adjoint(raw, shape, grad_mean, grad_axes, grad_log_opacity);
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
  store_sh(scene, first, kUsed, grad_rows, gradients.sh);
  __threadfence();
  __syncthreads();
  if (threadIdx.x == 0) last_block = atomicAdd(gradients.done_blocks, 1u) == gridDim.x - 1;
  __syncthreads();
  if (last_block) finish(scene, gradients);
}

}  // namespace

void launch_project(const Scene& scene, cudaStream_t stream) {
  const int blocks = (scene.count + kProjectGaussians - 1) / kProjectGaussians;
  if (blocks == 0) return;
  with_degree(scene.sh_degree, [&](auto degree) {
    project_kernel<decltype(degree)::value><<<blocks, kProjectThreads, 0, stream>>>(scene);
  });
}

void launch_project_adjoint(const Scene& scene, const Gradients& gradients, cudaStream_t stream) {
  const int blocks = max(1, (scene.count + kAdjointThreads - 1) / kAdjointThreads);
  with_degree(scene.sh_degree, [&](auto degree) {
    constexpr int kDegree = decltype(degree)::value;
    if (gradients.with_depth) {
      project_adjoint_kernel<kDegree, true>
          <<<blocks, kAdjointThreads, 0, stream>>>(scene, gradients);
    } else {
      project_adjoint_kernel<kDegree, false>
          <<<blocks, kAdjointThreads, 0, stream>>>(scene, gradients);
    }
  });
}

}  // namespace jade::splat::cuda
