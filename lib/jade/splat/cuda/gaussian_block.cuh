// SPDX-License-Identifier: Apache-2.0
// A block's Gaussians and cameras: parameters are read once, coalesced, for all views.
#pragma once

#include "jade/splat/cuda/tile_walk.cuh"
#include "jade/splat/math/projection.h"
#include "jade/splat/math/sh.h"

namespace jade::splat::cuda {

/// 16 coefficients of 3 channels, padded so that 16-byte loads of neighbouring rows have no bank
/// conflict.
constexpr int kShRow = 52;
constexpr int kCameraChunk = 16;  ///< cameras in shared memory at a time

/// Copies [count, 3 · stride] coefficients of the block's Gaussians to rows of kShRow, the first
/// `used` of each; rows are 16-byte aligned. Threads must synchronise before they read.
__device__ __forceinline__ void stage_sh(const RenderCall& call, int first, int gaussians, int used,
                                         float* rows) {
  const int width = 3 * call.sh_stride;
  const int count = min(gaussians, call.count - first);
  const float* const source = call.sh + int64_t(first) * width;
  if (width == 48 && used == 48) {
    for (int i = threadIdx.x; i < count * 12; i += blockDim.x) {
      const float4 value = __ldg(reinterpret_cast<const float4*>(source) + i);
      *reinterpret_cast<float4*>(rows + (i / 12) * kShRow + (i % 12) * 4) = value;
    }
    return;
  }
  for (int i = threadIdx.x; i < count * width; i += blockDim.x) {
    const int column = i % width;
    if (column < used) rows[(i / width) * kShRow + column] = __ldg(source + i);
  }
}

/// Loads cameras first … first + kCameraChunk − 1 into shared memory. Call between barriers.
__device__ __forceinline__ void stage_cameras(const RenderCall& call, int first,
                                              m::Camera<float>* cameras) {
  const int view = first + threadIdx.x;
  if (threadIdx.x < kCameraChunk && view < call.views) {
    float intrinsics[4];
    m::load_intrinsics(call.intrinsics, call.matrices, view, intrinsics);
    cameras[threadIdx.x] = m::make_camera<float>(call.camera_from_world + 16 * view, intrinsics,
                                                 call.width, call.height);
  }
}

__device__ __forceinline__ void load_raw(const RenderCall& call, int index,
                                         m::RawShape<float>* raw) {
  for (int k = 0; k < 3; ++k) raw->mean[k] = __ldg(call.means + 3ll * index + k);
  for (int k = 0; k < 3; ++k) raw->log_scale[k] = __ldg(call.log_scales + 3ll * index + k);
  for (int k = 0; k < 4; ++k) raw->quaternion[k] = __ldg(call.rotations + 4ll * index + k);
  raw->logit_opacity = __ldg(call.logit_opacities + index);
}

/// Loads one Gaussian; an unusable one is replaced by a unit Gaussian. `sh` is this thread's row.
template <int kDegree>
__device__ __forceinline__ bool load_gaussian(const RenderCall& call, bool activated, int index,
                                              const float* sh, m::RawShape<float>* raw) {
  bool usable = index < call.count;
  if (usable) {
    load_raw(call, index, raw);
    usable = m::is_usable(*raw, activated) && m::all_finite(sh, 3 * m::sh_count(kDegree));
  }
  m::replace_unusable(usable, raw);
  return usable;
}

/// Calls run(std::integral_constant degree) for the call's degree.
template <class Run>
void with_degree(int degree, const Run& run) {
  switch (degree) {
    case m::kPlainColor:
      return run(std::integral_constant<int, m::kPlainColor>());
    case 0:
      return run(std::integral_constant<int, 0>());
    case 1:
      return run(std::integral_constant<int, 1>());
    case 2:
      return run(std::integral_constant<int, 2>());
    default:
      return run(std::integral_constant<int, 3>());
  }
}

}  // namespace jade::splat::cuda
