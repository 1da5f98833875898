// SPDX-License-Identifier: Apache-2.0
// cuDNN picks Fourier transforms for these layers, whose 2 to 24 channels suit none of its engines:
// 2.8 ms a training step at 346x260 on an H200, of which these kernels leave 0.6.
#include "jade/kernel/launch.h"
#include "jade/router/conv_layer.h"

namespace jade::router::cuda {
namespace {

constexpr int kTileX = 32, kTileY = 8;
constexpr int kPixels = 2;  ///< neighbours in x that a thread computes
constexpr int kThreadsX = kTileX / kPixels;
constexpr int kGradientThreads = 160;

JADE_HD constexpr int round_up(int value, int step) { return (value + step - 1) / step * step; }

/// Where a tile's input comes from: a layer's input with its edge repeated, or the gradient of a
/// layer's output, zero outside the image and where ReLU held the value back.
struct Source {
  const float* values;
  const float* passed;  ///< [N,C,H,W] outputs of ReLU; null: there was none
  int height, width;
  bool replicate;

  __device__ float at(int plane, int y, int x) const {
    if (replicate) {
      y = min(max(y, 0), height - 1);
      x = min(max(x, 0), width - 1);
    } else if (y < 0 || y >= height || x < 0 || x >= width) {
      return 0;
    }
    const int64_t i = (int64_t{plane} * height + y) * width + x;
    const float value = values[i];
    return passed != nullptr && passed[i] <= 0 ? 0.f : value;
  }
};

/// out(o, y, x) = bias[o] + Σ w(o, i, dy, dx) source(i, y + dy + origin, x + dx + origin) over an
/// output of out_height x out_width. Transposed: w is read as that of the layer's input gradient.
template <int IN, int OUT, int K, bool TRANSPOSED>
__global__ void __launch_bounds__(kThreadsX* kTileY)
    convolve_kernel(Source source, const float* weights, const float* bias, bool relu, int origin,
                    float* out, int out_height, int out_width) {
  constexpr int kWide = kTileX + K - 1 + (K - 1) % 2, kHigh = kTileY + K - 1;
  constexpr int kOut = round_up(OUT, 4);
  __shared__ __align__(16) float tile[IN * kHigh * kWide];
  __shared__ __align__(16) float taps[IN * K * K * kOut];
  const int thread = threadIdx.y * kThreadsX + threadIdx.x;
  constexpr int kThreads = kThreadsX * kTileY;
  for (int i = thread; i < IN * K * K * kOut; i += kThreads) {
    const int o = i % kOut, tap = i / kOut % (K * K), c = i / (kOut * K * K);
    // [OUT,IN,K,K], or for the input's gradient [IN,OUT,K,K] turned by 180 degrees.
    const int from =
        TRANSPOSED ? (c * OUT + o) * K * K + (K * K - 1 - tap) : (o * IN + c) * K * K + tap;
    taps[i] = o < OUT ? weights[from] : 0.f;
  }
  const int x0 = blockIdx.x * kTileX, y0 = blockIdx.y * kTileY;
  for (int i = thread; i < IN * kHigh * kWide; i += kThreads) {
    const int x = i % kWide, y = i / kWide % kHigh, c = i / (kWide * kHigh);
    tile[i] = source.at(blockIdx.z * IN + c, y0 + y + origin, x0 + x + origin);
  }
  __syncthreads();

  float sum[kPixels][kOut] = {};
  for (int c = 0; c < IN; ++c) {
#pragma unroll
    for (int dy = 0; dy < K; ++dy) {
      float row[K + 1];
      const float* const from =
          tile + (c * kHigh + threadIdx.y + dy) * kWide + kPixels * threadIdx.x;
#pragma unroll
      for (int x = 0; x < K + 1; x += 2) {
        const float2 two = *reinterpret_cast<const float2*>(from + x);
        row[x] = two.x;
        row[x + 1] = two.y;
      }
#pragma unroll
      for (int dx = 0; dx < K; ++dx) {
        const float4* const tap =
            reinterpret_cast<const float4*>(taps + ((c * K + dy) * K + dx) * kOut);
#pragma unroll
        for (int o = 0; o < kOut / 4; ++o) {
          const float4 w = tap[o];
#pragma unroll
          for (int p = 0; p < kPixels; ++p) {
            sum[p][4 * o] += w.x * row[dx + p];
            sum[p][4 * o + 1] += w.y * row[dx + p];
            sum[p][4 * o + 2] += w.z * row[dx + p];
            sum[p][4 * o + 3] += w.w * row[dx + p];
          }
        }
      }
    }
  }

  const int y = y0 + threadIdx.y;
  if (y >= out_height) return;
#pragma unroll
  for (int o = 0; o < OUT; ++o) {
    const float offset = bias == nullptr ? 0.f : bias[o];
#pragma unroll
    for (int p = 0; p < kPixels; ++p) {
      const int x = x0 + kPixels * threadIdx.x + p;
      if (x >= out_width) continue;
      const float value = sum[p][o] + offset;
      out[(int64_t{blockIdx.z} * OUT + o) * out_height * out_width + int64_t{y} * out_width + x] =
          relu ? fmaxf(value, 0.f) : value;
    }
  }
}

/// Adds the gradients of the repeated border to the edge it repeats.
__global__ void fold_kernel(const float* padded, float* out, int planes, int height, int width,
                            int pad) {
  const int64_t i = int64_t{blockIdx.x} * blockDim.x + threadIdx.x;
  if (i >= int64_t{planes} * height * width) return;
  const int x = i % width, y = i / width % height;
  const int64_t plane = i / (int64_t{width} * height);
  const int wide = width + 2 * pad, high = height + 2 * pad;
  const int x_begin = x == 0 ? 0 : x + pad, x_end = x == width - 1 ? wide : x + pad + 1;
  const int y_begin = y == 0 ? 0 : y + pad, y_end = y == height - 1 ? high : y + pad + 1;
  float sum = 0;
  for (int yy = y_begin; yy < y_end; ++yy) {
    for (int xx = x_begin; xx < x_end; ++xx) sum += padded[(plane * high + yy) * wide + xx];
  }
  out[i] = sum;
}

/// Output channels whose gradients one thread sums: it holds group · K sums.
JADE_HD constexpr int group_of(int out) {
  return out % 4 == 0 ? 4 : out % 3 == 0 ? 3 : out % 5 == 0 ? 5 : 1;
}
/// A tile's sums are shared out over (input channel, row of the kernel, group of outputs), and what
/// threads are left over take other rows of the tile.
template <int IN, int OUT, int K>
struct WeightTasks {
  static constexpr int kGroup = group_of(OUT);
  static constexpr int kTasks = IN * K * (OUT / kGroup);
  static constexpr int kSplits = kGradientThreads >= kTasks ? kGradientThreads / kTasks : 1;
  static constexpr int kThreads = round_up(kTasks * kSplits, 32);
  static constexpr int kColumns = OUT * IN * K * K + OUT;
};

template <int IN, int OUT, int K>
__global__ void weight_gradient_kernel(Source in, Source of_out, float* partial) {
  using Tasks = WeightTasks<IN, OUT, K>;
  constexpr int kGroup = Tasks::kGroup;
  constexpr int kWide = kTileX + K - 1, kHigh = kTileY + K - 1;
  constexpr int kPlane = kHigh * kWide + 1;  // apart by a bank
  __shared__ float inputs[IN * kPlane];
  __shared__ float gradients[OUT * kTileY * kTileX];
  const int x0 = blockIdx.x * kTileX, y0 = blockIdx.y * kTileY;
  for (int i = threadIdx.x; i < IN * kHigh * kWide; i += Tasks::kThreads) {
    const int x = i % kWide, y = i / kWide % kHigh, c = i / (kWide * kHigh);
    inputs[c * kPlane + y * kWide + x] = in.at(blockIdx.z * IN + c, y0 + y - K / 2, x0 + x - K / 2);
  }
  for (int i = threadIdx.x; i < OUT * kTileY * kTileX; i += Tasks::kThreads) {
    const int x = i % kTileX, y = i / kTileX % kTileY, o = i / (kTileX * kTileY);
    gradients[i] = of_out.at(blockIdx.z * OUT + o, y0 + y, x0 + x);
  }
  __syncthreads();
  if (threadIdx.x >= Tasks::kTasks * Tasks::kSplits) return;

  const int task = threadIdx.x % Tasks::kTasks, split = threadIdx.x / Tasks::kTasks;
  const int dy = task % K, c = task / K % IN, first = task / (K * IN) * kGroup;
  float sum[kGroup][K] = {};
  float plain[kGroup] = {};
  for (int y = split; y < kTileY; y += Tasks::kSplits) {
    const float* const row = inputs + c * kPlane + (y + dy) * kWide;
    const float* const g = gradients + (first * kTileY + y) * kTileX;
    float window[K];
#pragma unroll
    for (int dx = 0; dx < K - 1; ++dx) window[dx + 1] = row[dx];
#pragma unroll 8
    for (int x = 0; x < kTileX; ++x) {
#pragma unroll
      for (int dx = 0; dx < K - 1; ++dx) window[dx] = window[dx + 1];
      window[K - 1] = row[x + K - 1];
#pragma unroll
      for (int o = 0; o < kGroup; ++o) {
        const float value = g[o * kTileY * kTileX + x];
        plain[o] += value;
#pragma unroll
        for (int dx = 0; dx < K; ++dx) sum[o][dx] += value * window[dx];
      }
    }
  }

  const int64_t block = (int64_t{blockIdx.z} * gridDim.y + blockIdx.y) * gridDim.x + blockIdx.x;
  float* const to = partial + (block * Tasks::kSplits + split) * Tasks::kColumns;
#pragma unroll
  for (int o = 0; o < kGroup; ++o) {
#pragma unroll
    for (int dx = 0; dx < K; ++dx) to[(((first + o) * IN + c) * K + dy) * K + dx] = sum[o][dx];
    if (c == 0 && dy == 0) to[OUT * IN * K * K + first + o] = plain[o];
  }
}

constexpr int kSumColumns = 32, kSumRows = 16;

/// Column sums of [rows, columns], each in the same order every time.
__global__ void column_sum_kernel(const float* partial, int64_t rows, int columns, float* out) {
  __shared__ float sums[kSumRows][kSumColumns];
  const int column = blockIdx.x * kSumColumns + threadIdx.x;
  float sum = 0;
  if (column < columns) {
    for (int64_t row = threadIdx.y; row < rows; row += kSumRows) {
      sum += partial[row * columns + column];
    }
  }
  sums[threadIdx.y][threadIdx.x] = sum;
  __syncthreads();
  if (threadIdx.y != 0 || column >= columns) return;
  for (int row = 1; row < kSumRows; ++row) sum += sums[row][threadIdx.x];
  out[column] = sum;
}

template <int IN, int OUT, int K>
struct Layer {
  static void forward(const ConvLayer& layer, cudaStream_t stream) {
    const dim3 grid(kernel::grid_size(layer.width, kTileX), kernel::grid_size(layer.height, kTileY),
                    layer.batch);
    const Source source{layer.in, nullptr, layer.height, layer.width, true};
    convolve_kernel<IN, OUT, K, false><<<grid, dim3(kThreadsX, kTileY), 0, stream>>>(
        source, layer.weights, layer.bias, layer.relu, -(K / 2), layer.out, layer.height,
        layer.width);
  }

  static void backward(const ConvGradient& args, cudaStream_t stream) {
    const ConvLayer& layer = args.layer;
    const Source in{layer.in, nullptr, layer.height, layer.width, true};
    const Source of_out{args.of_out, layer.relu ? layer.out : nullptr, layer.height, layer.width,
                        false};
    using Tasks = WeightTasks<IN, OUT, K>;
    const dim3 grid(kernel::grid_size(layer.width, kTileX), kernel::grid_size(layer.height, kTileY),
                    layer.batch);
    weight_gradient_kernel<IN, OUT, K>
        <<<grid, Tasks::kThreads, 0, stream>>>(in, of_out, args.partial);
    column_sum_kernel<<<kernel::grid_size(Tasks::kColumns, kSumColumns),
                        dim3(kSumColumns, kSumRows), 0, stream>>>(args.partial, partial_rows(layer),
                                                                  Tasks::kColumns, args.of_weights);
    if (args.of_in == nullptr) return;
    const int high = layer.height + K - 1, wide = layer.width + K - 1;
    const dim3 padded(kernel::grid_size(wide, kTileX), kernel::grid_size(high, kTileY),
                      layer.batch);
    convolve_kernel<OUT, IN, K, true><<<padded, dim3(kThreadsX, kTileY), 0, stream>>>(
        of_out, layer.weights, nullptr, false, -(K - 1), K == 1 ? args.of_in : args.padded, high,
        wide);
    if (K == 1) return;
    const int64_t count = int64_t{layer.batch} * IN * layer.height * layer.width;
    fold_kernel<<<kernel::grid_size(count, 256), 256, 0, stream>>>(
        args.padded, args.of_in, layer.batch * IN, layer.height, layer.width, K / 2);
  }
};

/// Calls `use` with the compiled layer of a shape; false where there is none.
template <class Use>
bool dispatch(const ConvShape& shape, const Use& use) {
  const auto is = [&](int in, int out, int kernel) {
    return shape.in == in && shape.out == out && shape.kernel == kernel;
  };
  if (is(2, 16, 5)) return use(Layer<2, 16, 5>{}, WeightTasks<2, 16, 5>{}), true;
  if (is(16, 6, 5)) return use(Layer<16, 6, 5>{}, WeightTasks<16, 6, 5>{}), true;
  if (is(3, 10, 5)) return use(Layer<3, 10, 5>{}, WeightTasks<3, 10, 5>{}), true;
  if (is(10, 8, 5)) return use(Layer<10, 8, 5>{}, WeightTasks<10, 8, 5>{}), true;
  if (is(17, 9, 3)) return use(Layer<17, 9, 3>{}, WeightTasks<17, 9, 3>{}), true;
  if (is(9, 24, 3)) return use(Layer<9, 24, 3>{}, WeightTasks<9, 24, 3>{}), true;
  if (is(24, 1, 1)) return use(Layer<24, 1, 1>{}, WeightTasks<24, 1, 1>{}), true;
  return false;
}

}  // namespace

bool is_compiled(const ConvShape& shape) {
  return dispatch(shape, [](auto, auto) {});
}

int64_t partial_rows(const ConvLayer& layer) {
  const int64_t blocks = layer.batch * kernel::block_count(layer.width, kTileX) *
                         kernel::block_count(layer.height, kTileY);
  int64_t rows = 0;
  dispatch(layer.shape, [&](auto, auto tasks) { rows = blocks * decltype(tasks)::kSplits; });
  return rows;
}

void conv_forward(const ConvLayer& layer, cudaStream_t stream) {
  dispatch(layer.shape, [&](auto compiled, auto) { compiled.forward(layer, stream); });
}

void conv_backward(const ConvGradient& gradient, cudaStream_t stream) {
  dispatch(gradient.layer.shape, [&](auto compiled, auto) { compiled.backward(gradient, stream); });
}

}  // namespace jade::router::cuda
