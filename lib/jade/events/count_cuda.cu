// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <c10/cuda/CUDAGuard.h>
#include <c10/cuda/CUDAStream.h>

#include "jade/events/count.h"
#include "jade/events/count_math.h"
#include "jade/kernel/launch.h"

namespace jade::events::cuda {
namespace {

constexpr int kThreads = 256;
constexpr int kSpansPerLaunch = 64;

struct SpanBounds {
  int64_t at[kSpansPerLaunch + 1];
  int count;
};

struct KernelArguments {
  const float* x;
  const float* y;
  const int8_t* polarity;
  int32_t width, height;
  unsigned long long* out;
};

/// One thread per event. Integer atomics commute, so the sums equal the CPU's bit for bit.
__global__ void count_kernel(KernelArguments in, SpanBounds bounds) {
  const int64_t i = bounds.at[0] + int64_t(blockIdx.x) * kThreads + threadIdx.x;
  if (i >= bounds.at[bounds.count]) return;
  int low = 0, high = bounds.count;  // the last span that begins at or before i
  while (high - low > 1) {
    const int middle = (low + high) / 2;
    if (bounds.at[middle] <= i) {
      low = middle;
    } else {
      high = middle;
    }
  }
  EventFootprint where;
  if (!locate(in.x[i], in.y[i], in.width, in.height, where)) return;
  const int64_t pixels = int64_t(in.width) * in.height;
  unsigned long long* plane = in.out + (2 * int64_t(low) + (in.polarity[i] > 0 ? 0 : 1)) * pixels;
  spread(where, in.width, in.height, [plane](int64_t pixel, int64_t weight) {
    atomicAdd(plane + pixel, static_cast<unsigned long long>(weight));
  });
}

}  // namespace

void count(const CountArguments& arguments, int device_index) {
  const c10::cuda::CUDAGuard guard(static_cast<c10::DeviceIndex>(device_index));
  const auto stream = c10::cuda::getCurrentCUDAStream(static_cast<c10::DeviceIndex>(device_index));
  const auto& bounds = *arguments.bounds;
  const int spans = static_cast<int>(bounds.size()) - 1;
  const int64_t plane_pair = 2 * int64_t(arguments.width) * arguments.height;
  for (int first = 0; first < spans; first += kSpansPerLaunch) {
    SpanBounds part{};
    part.count = std::min(kSpansPerLaunch, spans - first);
    std::copy_n(bounds.begin() + first, part.count + 1, part.at);
    const int64_t events = part.at[part.count] - part.at[0];
    if (events == 0) continue;
    const KernelArguments in{
        arguments.x,
        arguments.y,
        arguments.polarity,
        arguments.width,
        arguments.height,
        reinterpret_cast<unsigned long long*>(arguments.out + first * plane_pair)};
    count_kernel<<<kernel::grid_size(events, kThreads), kThreads, 0, stream.stream()>>>(in, part);
    kernel::check_launch("the counting of events");
  }
}

}  // namespace jade::events::cuda
