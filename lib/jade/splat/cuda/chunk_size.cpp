// SPDX-License-Identifier: Apache-2.0
#include "jade/splat/cuda/chunk_size.h"

#include <algorithm>
#include <cuda_runtime_api.h>

#include "jade/core/error.h"

namespace jade::splat::cuda {

namespace {

constexpr int64_t kLeastGaussians = 256;  ///< fewer would leave threads of a block idle
int forced_gaussians = -1;

int multiprocessors() {
  int device = 0, count = 0;
  if (cudaGetDevice(&device) != cudaSuccess ||
      cudaDeviceGetAttribute(&count, cudaDevAttrMultiProcessorCount, device) != cudaSuccess) {
    throw DeviceError("the GPU does not say how many multiprocessors it has");
  }
  return count;
}

int64_t divide_up(int64_t a, int64_t b) { return (a + b - 1) / b; }

}  // namespace

int chunk_gaussians(const RenderCall& call) {
  if (forced_gaussians >= 0) return forced_gaussians;
  if (call.tiles > kMostChunkTiles) return 0;
  const int64_t at_once = int64_t{kChunkBlocks} * multiprocessors();
  const int64_t rounds = divide_up(int64_t{call.count} * call.views, at_once * kMostChunkGaussians);
  const int64_t chunks = std::max<int64_t>(rounds * at_once / call.views, 1);
  const int64_t gaussians = divide_up(divide_up(call.count, chunks), 32) * 32;
  return static_cast<int>(std::clamp<int64_t>(gaussians, kLeastGaussians, kMostChunkGaussians));
}

void set_chunk_gaussians_for_test(int gaussians) { forced_gaussians = gaussians; }

}  // namespace jade::splat::cuda
