// SPDX-License-Identifier: Apache-2.0
// One Gaussian per thread: projects it into every view, or sums its gradient over all views.
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
  if (!m::is_drawable(screen, call.near_plane, call.far_plane)) return splat;
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

/// A warp's records of one view, staged for writing in whole sectors.
struct SplatStage {
  float4 parts[3 * 32];
};

/// Writes the splats of Gaussians first … first + 31 of a view, one per lane.
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
  __shared__ __align__(16) float sh_rows[kProjectGaussians * kShRow];
  __shared__ m::Camera<float> cameras[kCameraChunk];
  __shared__ SplatStage stages[kProjectThreads / 32];
  const int first = blockIdx.x * kProjectGaussians, row = threadIdx.x % kProjectGaussians;
  const int index = first + row, group = threadIdx.x / kProjectGaussians;
  stage_sh(call, first, kProjectGaussians, 3 * m::sh_count(kDegree), sh_rows);
  __syncthreads();
  const float* const sh = sh_rows + row * kShRow;
  m::RawShape<float> raw{};
  const bool usable = load_gaussian<kDegree>(call, call.activated, index, sh, &raw);
  if (!usable && index < call.count && group == 0) atomicAdd(&call.counters->rejected, 1ull);
  const m::Shape<float> shape = m::activate(raw, call.activated);
  for (int chunk = 0; chunk < call.views; chunk += kCameraChunk) {
    const int length = min(kCameraChunk, call.views - chunk);
    __syncthreads();
    stage_cameras(call, chunk, cameras);
    __syncthreads();
    for (int step = group; step < length; step += kViewGroups) {
      // Blocks start at different views, so that their atomics conflict less.
      const int in_chunk = kCount ? (step + int(blockIdx.x)) % length : step;
      const int view = chunk + in_chunk;
      Splat splat{};
      if (usable) splat = make_splat<kDegree>(call, shape, cameras[in_chunk], sh);
      store_splats(call, view, first + (row & ~31), splat, stages[threadIdx.x / 32]);
      if (kCount) {
        TileList* const lists = call.tile_list + view * call.tiles;
        walk_tiles(
            splat, splat.depth > 0, call, [](int, int) {},
            [&](int tile, uint32_t) { atomicAdd(&lists[tile].count, 1u); });
      }
    }
  }
}

// ---- adjoint ----------------------------------------------------------------------------------

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

/// Threads that share a Gaussian's views. Each then sums a third of the SH gradients over all
/// views.
constexpr int kAdjointGroups = 3;
constexpr int kAdjointThreads = kAdjointGaussians * kAdjointGroups;
constexpr int kAdjointViews = 12;                ///< in shared memory at a time
constexpr int kAdjointBlocks = 4;                ///< per multiprocessor
constexpr int kHalves = kAdjointGaussians / 32;  ///< warps of a group
static_assert(kAdjointViews <= kCameraChunk, "their cameras fit");

constexpr int kShapeValues = sizeof(m::ShapeGradient<float>) / sizeof(float);

struct __align__(16) AdjointShared {
  float sh_rows[kAdjointGaussians * kShRow];  // then their gradients
  m::Camera<float> cameras[kCameraChunk];
  union {
    float on_sh[kAdjointViews][6][kAdjointGaussians];
    float on_shape[kAdjointGroups - 1][kShapeValues][kAdjointGaussians];  // at the end
  };
  float camera_sums[kAdjointViews][kHalves][12];
  float norm[kAdjointThreads], visible[kAdjointThreads], radius[kAdjointThreads];  // statistics
  bool last_block;
};

__device__ __forceinline__ void add_statistics(const RenderCall& call, const m::Shape<float>& shape,
                                               const m::Camera<float>& camera,
                                               const m::ScreenGradient<float>& on_screen,
                                               AdjointShared& s) {
  const int t = threadIdx.x;
  s.norm[t] += m::ndc_gradient_norm(on_screen, call.width, call.height);
  s.visible[t] += 1;
  s.radius[t] = fmaxf(s.radius[t], m::screen_radius(shape, camera));
}

/// Sums of 32 neighbouring splats, read in whole sectors.
template <int kValues>
__device__ __forceinline__ void stage_sums(const float* source, int splats, float* stage) {
  const int lane = threadIdx.x & 31;
  __syncwarp();
  if (splats == 32) {
    float values[kValues];
    for (int k = 0; k < kValues; ++k) values[k] = __ldg(source + 32 * k + lane);
    for (int k = 0; k < kValues; ++k) stage[32 * k + lane] = values[k];
  } else {
#pragma unroll 1
    for (int i = lane; i < splats * kValues; i += 32) stage[i] = __ldg(source + i);
  }
  __syncwarp();
}

__device__ __forceinline__ void keep_camera(const m::CameraGradient<float>& on_camera,
                                            float* target) {
  float values[16];
  for (int k = 0; k < 9; ++k) values[k] = on_camera.rotation[k];
  for (int k = 0; k < 3; ++k) values[9 + k] = on_camera.translation[k];
  for (int k = 12; k < 16; ++k) values[k] = 0;
  const int lane = threadIdx.x & 31;
  const float sum = sum_sixteen(values, lane);
  if ((lane & 1) == 0 && lane < 24) target[lane / 2] = sum;
}

/// Adds the block's camera gradients to the views', or stores them for finish().
__device__ __forceinline__ void add_cameras(const RenderCall& call, const Gradients& gradients,
                                            int first_view, int views, const AdjointShared& s) {
  for (int i = threadIdx.x; i < views * 12; i += kAdjointThreads) {
    float sum = 0;
    for (int half = 0; half < kHalves; ++half) sum += s.camera_sums[i / 12][half][i % 12];
    const int64_t element = int64_t(first_view) * 12 + i;
    if (gradients.camera_partial != nullptr) {
      gradients.camera_partial[int64_t(blockIdx.x) * call.views * 12 + element] = sum;
    } else {
      atomicAdd(gradients.camera_sums + element, sum);
    }
  }
}

/// A thread's share of its Gaussian's SH gradients over `views` views; replaces the coefficients.
template <int kDegree, int kGroup>
__device__ __forceinline__ void sum_sh(int views, int row, AdjointShared& s) {
  constexpr int kCount = m::sh_count(kDegree);
  constexpr int kBegin = (kCount * kGroup + kAdjointGroups - 1) / kAdjointGroups;
  constexpr int kEnd = (kCount * (kGroup + 1) + kAdjointGroups - 1) / kAdjointGroups;
  if constexpr (kBegin < kEnd) {
    float sums[3 * (kEnd - kBegin)] = {};
    for (int view = 0; view < views; ++view) {
      float direction[3], color[3], basis[16];
      for (int c = 0; c < 3; ++c) {
        direction[c] = s.on_sh[view][c][row];
        color[c] = s.on_sh[view][3 + c][row];
      }
      m::sh_basis(kDegree, direction, basis);
      m::add_sh_gradient(kBegin, kEnd, basis, color, sums);
    }
    float* const out = s.sh_rows + row * kShRow + 3 * kBegin;
    for (int k = 0; k < 3 * (kEnd - kBegin); ++k) out[k] = sums[k];
  }
}

/// Runs in the last block: converts camera and background gradients to their final form.
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
  if (threadIdx.x < 3 && gradients.background != nullptr) {
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

/// Writes rows of kShRow to [N, sh_stride, 3], or adds to the existing values; coefficients above
/// the active degree get 0.
__device__ __forceinline__ void store_sh(const RenderCall& call, int first, int used, bool add,
                                         const float* rows, float* target) {
  const int width = 3 * call.sh_stride;
  const int count = min(kAdjointGaussians, call.count - first);
  float* const out = target + int64_t(first) * width;
  if (width == 48 && used == 48 && !add) {
    for (int i = threadIdx.x; i < count * 12; i += blockDim.x) {
      reinterpret_cast<float4*>(out)[i] =
          *reinterpret_cast<const float4*>(rows + (i / 12) * kShRow + (i % 12) * 4);
    }
    return;
  }
  for (int i = threadIdx.x; i < count * width; i += blockDim.x) {
    const int column = i % width;
    const float value = column < used ? rows[(i / width) * kShRow + column] : 0.0f;
    out[i] = add ? out[i] + value : value;
  }
}

__device__ __forceinline__ void store_mean2d(const RenderCall& call, int view, int index, float x,
                                             float y, float* target) {
  reinterpret_cast<float2*>(target)[int64_t(view) * call.count + index] = make_float2(x, y);
}

/// Adds a view's gradient to a thread's Gaussian and, summed over the warp, to the camera.
template <int kDegree, bool kDepth, bool kGeneral>
__device__ __forceinline__ void gather_view(const RenderCall& call, const Gradients& gradients,
                                            const m::Shape<float>& shape, int view, int in_chunk,
                                            int row, int index, float* stage, AdjointShared& s,
                                            m::ShapeGradient<float>* on_shape) {
  constexpr int kValues = m::kPixelSums + kDepth;
  const int first = index - (threadIdx.x & 31);
  Splat splat{};
  if (index < call.count) splat = load_splat(call.splats + int64_t(view) * call.count + index);
  stage_sums<kValues>(gradients.sums + (int64_t(view) * call.count + first) * kValues,
                      min(32, call.count - first), stage);
  m::CameraGradient<float> on_camera{};
  m::ShGradient<float> on_sh{};
  if (splat.depth > 0) {
    const m::Camera<float>& camera = s.cameras[in_chunk];
    const m::ScreenGradient<float> on_screen =
        m::view_adjoint({camera, kDegree, call.antialiased}, shape, s.sh_rows + row * kShRow,
                        load_drawn<kDepth>(splat, stage + (threadIdx.x & 31) * kValues), on_shape,
                        &on_sh, &on_camera);
    const bool counts = gradients.statistics_views < 0 || view < gradients.statistics_views;
    if (gradients.gradient_norm != nullptr && counts) {
      add_statistics(call, shape, camera, on_screen, s);
    }
    if (kGeneral && gradients.means2d != nullptr) {
      store_mean2d(call, view, index, on_screen.x, on_screen.y, gradients.means2d);
    }
  } else if (kGeneral && gradients.means2d != nullptr && index < call.count) {
    store_mean2d(call, view, index, 0, 0, gradients.means2d);
  }
  for (int c = 0; c < 3; ++c) {
    s.on_sh[in_chunk][c][row] = on_sh.direction[c];
    s.on_sh[in_chunk][3 + c][row] = on_sh.color[c];
  }
  if (gradients.camera_from_world != nullptr) {
    keep_camera(on_camera, s.camera_sums[in_chunk][row / 32]);
  }
}

/// Adds the sums of the other threads of a Gaussian, and writes its gradients except SH.
__device__ __forceinline__ void store_gaussian(const RenderCall& call, const Gradients& gradients,
                                               bool usable, bool activated, int row, int index,
                                               const AdjointShared& s,
                                               m::ShapeGradient<float> on_shape) {
  float values[kShapeValues];
  memcpy(values, &on_shape, sizeof(on_shape));
  for (int group = 0; group < kAdjointGroups - 1; ++group) {
    for (int k = 0; k < kShapeValues; ++k) values[k] += s.on_shape[group][k][row];
  }
  memcpy(&on_shape, values, sizeof(on_shape));
  m::RawShape<float> raw;  // loaded again, because registers limit the kernel
  load_raw(call, index, &raw);
  m::replace_unusable(usable, &raw);
  const m::RawShape<float> grad =
      m::activate_adjoint(raw, m::activate(raw, activated), on_shape, activated);
  for (int k = 0; k < 3; ++k) gradients.means[3ll * index + k] = grad.mean[k];
  for (int k = 0; k < 4; ++k) gradients.rotations[4ll * index + k] = grad.quaternion[k];
  for (int k = 0; k < 3; ++k) gradients.log_scales[3ll * index + k] = grad.log_scale[k];
  gradients.logit_opacities[index] = grad.logit_opacity;
  if (gradients.gradient_norm == nullptr) return;
  for (int t = row; t < kAdjointThreads; t += kAdjointGaussians) {
    gradients.gradient_norm[index] += s.norm[t];
    gradients.visible_count[index] += s.visible[t];
    gradients.max_radius_px[index] = fmaxf(gradients.max_radius_px[index], s.radius[t]);
  }
}

/// kGeneral: supports activated parameters and screen gradients too, which costs registers.
template <int kDegree, bool kDepth, bool kGeneral>
__global__ void __launch_bounds__(kAdjointThreads, kAdjointBlocks)
    project_adjoint_kernel(const __grid_constant__ RenderCall call,
                           const __grid_constant__ Gradients gradients) {
  constexpr int kUsed = 3 * m::sh_count(kDegree);
  __shared__ AdjointShared s;
  __shared__ float stages[kAdjointThreads / 32][32 * (m::kPixelSums + kDepth)];
  const int first = blockIdx.x * kAdjointGaussians, row = threadIdx.x % kAdjointGaussians;
  const int index = first + row, group = threadIdx.x / kAdjointGaussians;
  const bool activated = kGeneral && call.activated;
  bool usable = false;
  m::Shape<float> shape;
  m::ShapeGradient<float> on_shape{};
  s.norm[threadIdx.x] = s.visible[threadIdx.x] = s.radius[threadIdx.x] = 0;
  for (int chunk = 0; chunk == 0 || chunk < call.views; chunk += kAdjointViews) {
    const int views = min(kAdjointViews, call.views - chunk);
    stage_sh(call, first, kAdjointGaussians, kUsed, s.sh_rows);
    stage_cameras(call, chunk, s.cameras);
    __syncthreads();
    if (chunk == 0) {
      m::RawShape<float> raw{};
      usable = load_gaussian<kDegree>(call, activated, index, s.sh_rows + row * kShRow, &raw);
      shape = m::activate(raw, activated);
    }
    for (int view = group; view < views; view += kAdjointGroups) {
      gather_view<kDegree, kDepth, kGeneral>(call, gradients, shape, chunk + view, view, row, index,
                                             stages[threadIdx.x / 32], s, &on_shape);
    }
    __syncthreads();
    if (gradients.camera_from_world != nullptr) add_cameras(call, gradients, chunk, views, s);
    switch (group) {
      case 0:
        sum_sh<kDegree, 0>(views, row, s);
        break;
      case 1:
        sum_sh<kDegree, 1>(views, row, s);
        break;
      default:
        sum_sh<kDegree, 2>(views, row, s);
    }
    __syncthreads();
    store_sh(call, first, kUsed, chunk > 0, s.sh_rows, gradients.sh);
    __syncthreads();
  }
  if (group > 0) {
    float values[kShapeValues];
    memcpy(values, &on_shape, sizeof(on_shape));
    for (int k = 0; k < kShapeValues; ++k) s.on_shape[group - 1][k][row] = values[k];
  }
  __syncthreads();
  if (group == 0 && index < call.count) {
    store_gaussian(call, gradients, usable, activated, row, index, s, on_shape);
  }
  __threadfence();
  __syncthreads();
  if (threadIdx.x == 0) s.last_block = atomicAdd(gradients.done_blocks, 1u) == gridDim.x - 1;
  __syncthreads();
  if (s.last_block) finish(call, gradients);
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
  const int blocks = max(1, (call.count + kAdjointGaussians - 1) / kAdjointGaussians);
  const bool general = call.activated || gradients.means2d != nullptr;
  with_degree(call.sh_degree, [&](auto degree) {
    constexpr int kDegree = decltype(degree)::value;
    // Only Python uses plain colours, so one kernel covers all other options.
    constexpr bool kPlain = kDegree == m::kPlainColor;
    if (gradients.with_depth && (general || kPlain)) {
      project_adjoint_kernel<kDegree, true, true>
          <<<blocks, kAdjointThreads, 0, stream>>>(call, gradients);
    } else if (general || kPlain) {
      project_adjoint_kernel<kDegree, false, true>
          <<<blocks, kAdjointThreads, 0, stream>>>(call, gradients);
    } else if (gradients.with_depth) {
      project_adjoint_kernel<kDegree, true, kPlain>
          <<<blocks, kAdjointThreads, 0, stream>>>(call, gradients);
    } else {
      project_adjoint_kernel<kDegree, false, kPlain>
          <<<blocks, kAdjointThreads, 0, stream>>>(call, gradients);
    }
  });
}

}  // namespace jade::splat::cuda
