// SPDX-License-Identifier: Apache-2.0
// The kernels as functions: each enqueues its work on `stream` and returns at once.
#pragma once

#include <cuda_runtime_api.h>

#include "jade/splat/cuda/layout.h"

namespace jade::splat::cuda {

/// All views: screen records and, without chunks, the number of instances of each tile.
void launch_project(const RenderCall& call, cudaStream_t stream);
/// The chunks' instances, tile by tile, and the number of instances of each tile.
void launch_chunks(const RenderCall& call, cudaStream_t stream);
/// Counts instances, and lists by their length.
void launch_count_lists(const RenderCall& call, cudaStream_t stream);
/// Divides `keys` into the tiles' lists and orders the tiles, longest list first.
/// @param inbox  [2] on the host, writable by the device: instances and Gaussians; null: not
///   requested
void launch_plan(const RenderCall& call, long long* rejected, volatile uint64_t* inbox,
                 cudaStream_t stream);
/// Copies the instances into the lists and sorts each by (depth, index).
void launch_fill(const RenderCall& call, cudaStream_t stream);
/// If a gradient will be needed, removes from entries the quarters that the adjoint can skip, and
/// zeroes `clearing`.
void launch_blend(const RenderCall& call, const Images& images, const Clearing& clearing,
                  cudaStream_t stream);

/// Sums over pixels into `gradients.sums`, or into slots if those are set.
void launch_blend_adjoint(const RenderCall& call, const ImageGradients& images,
                          const Gradients& gradients, cudaStream_t stream);
/// Sums slots in a fixed order.
void launch_gather(const RenderCall& call, const Gradients& gradients, cudaStream_t stream);
/// From sums to parameter, camera and background gradients and statistics.
void launch_project_adjoint(const RenderCall& call, const Gradients& gradients,
                            cudaStream_t stream);

}  // namespace jade::splat::cuda
