// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <c10/cuda/CUDAStream.h>

#include "jade/kernel/launch.h"
#include "jade/train/batch_copy.h"

namespace jade::train::cuda {
namespace {

constexpr int kThreads = 256;
constexpr int kMostCopies = 64;  ///< per launch: they are passed as its argument
constexpr int64_t kChunk = 16384;

struct Batch {
  BufferCopy copies[kMostCopies];
  int64_t end_block[kMostCopies];  ///< the first block after this copy
};

/// Copies [begin, end) bytes in units of T, whose size divides both and the addresses.
template <class T>
__device__ void copy_span(const BufferCopy& copy, int64_t begin, int64_t end) {
  const T* const from = static_cast<const T*>(copy.from);
  T* const to = static_cast<T*>(copy.to);
  const int64_t last = end / static_cast<int64_t>(sizeof(T));
  for (int64_t i = begin / static_cast<int64_t>(sizeof(T)) + threadIdx.x; i < last; i += kThreads) {
    to[i] = from[i];
  }
}

/// One block copies one chunk of one of the buffers.
__global__ void __launch_bounds__(kThreads) copy_kernel(Batch batch) {
  const int64_t block = blockIdx.x;
  int index = 0;
  while (block >= batch.end_block[index]) ++index;
  const BufferCopy& copy = batch.copies[index];
  const int64_t first_block = index == 0 ? 0 : batch.end_block[index - 1];
  const int64_t begin = (block - first_block) * kChunk;
  const int64_t end = begin + kChunk < copy.bytes ? begin + kChunk : copy.bytes;
  const auto bits = reinterpret_cast<unsigned long long>(copy.from) |
                    reinterpret_cast<unsigned long long>(copy.to);
  if (bits % sizeof(int4) == 0) {
    const int64_t whole = end - end % static_cast<int64_t>(sizeof(int4));
    copy_span<int4>(copy, begin, whole);
    copy_span<char>(copy, whole, end);
  } else if ((bits | static_cast<unsigned long long>(copy.bytes)) % sizeof(float) == 0) {
    copy_span<float>(copy, begin, end);
  } else {
    copy_span<char>(copy, begin, end);
  }
}

}  // namespace

void copy_all(const std::vector<BufferCopy>& copies) {
  const size_t most = kMostCopies;
  for (size_t first = 0; first < copies.size(); first += most) {
    Batch batch{};
    int64_t blocks = 0;
    const size_t count = std::min(most, copies.size() - first);
    for (size_t i = 0; i < count; ++i) {
      batch.copies[i] = copies[first + i];
      blocks += kernel::block_count(batch.copies[i].bytes, kChunk);
      batch.end_block[i] = blocks;
    }
    if (blocks == 0) continue;
    copy_kernel<<<static_cast<unsigned>(blocks), kThreads, 0, c10::cuda::getCurrentCUDAStream()>>>(
        batch);
    kernel::check_launch("the copies of a step's inputs");
  }
}

}  // namespace jade::train::cuda
