// SPDX-License-Identifier: Apache-2.0
// Gradients of the router's weights as matrix products: (input channel, tap) x output channels,
// summed over pixels. Several layers in one launch.
#include <algorithm>

#include "jade/kernel/launch.h"
#include "jade/router/conv_shape.cuh"

namespace jade::router::cuda {
namespace {

constexpr int kThreads = 256, kWarps = kThreads / 32;
constexpr int kHalfY = kTileY / 2;  ///< neighbouring sums are this many rows apart
constexpr int64_t kMaxRows = 192;   ///< maximum number of rows of partial sums, which tiles share

struct Tiles {
  int x, y, images;
};

/// Products of a layer. Words contain pixels (y, x) and (y + kHalfY, x), so that any tap reads
/// whole words; their banks are x + 8 · (kernel row), with a distance of 8 between the rows of a
/// product's eight taps, across channels too.
template <class Conv, bool BIAS>
struct Sizes {
  static constexpr int kIn = Conv::kIn, kOut = Conv::kOut, kKernel = Conv::kKernel;
  static constexpr bool kBias = BIAS;
  static constexpr int kWide = kTileX + 8, kHigh = kHalfY + kKernel - 1;
  static constexpr int kRead = kTileX + kKernel - 1;  ///< of each row
  static constexpr int kPlane = kHigh * kWide + (kKernel * 8 - kHigh * kWide % 32 + 32) % 32;
  static constexpr int kOutPlane = kHalfY * kTileX + 4;
  static constexpr int kTaps = kIn * kKernel * kKernel;
  /// The gradient of the bias is that of a weight whose input is one everywhere: an additional
  /// channel.
  static constexpr int kRows = kTaps + kBias, kPlanes = kIn + kBias;
  static constexpr int kTiles = round_up(kRows, 16) / 16;  ///< of the product, 16 rows each
  static constexpr int kPerWarp = round_up(kTiles, kWarps) / kWarps;
  static constexpr int kColumns = round_up(kOut, 8) / 8;
  static constexpr int kInWords = kPlanes * kPlane, kOutWords = kOut * kOutPlane;
  static constexpr int kShared = kInWords + kOutWords;
  static constexpr int kWeights = kTaps * kOut + kBias * kOut;
};

/// Planes of a tile in shared memory, read twice: for the largest number, then to store it scaled.
template <class Source, int CHANNELS, int WIDE, int HIGH>
struct Planes {
  const Source& source;
  int image, y0, x0;
  uint32_t* to;
  int stride, plane;

  /// Returns the thread's largest number.
  __device__ float largest() const {
    float largest = 0;
#pragma unroll 1
    for (int i = threadIdx.x; i < WIDE * (HIGH + kHalfY); i += kThreads) {
      float values[CHANNELS];
      source.read(image, y0 + i / WIDE, x0 + i % WIDE, values);
      largest = fmaxf(largest, largest_of(values));
    }
    return largest;
  }

  __device__ void store(float factor) const {
#pragma unroll 1
    for (int i = threadIdx.x; i < WIDE * HIGH; i += kThreads) {
      const int y = i / WIDE, x = i % WIDE;
      float upper[CHANNELS], lower[CHANNELS];
      source.read(image, y0 + y, x0 + x, upper);
      source.read(image, y0 + y + kHalfY, x0 + x, lower);
#pragma unroll
      for (int c = 0; c < CHANNELS; ++c) {
        to[c * plane + y * stride + x] = kernel::to_halves(factor * upper[c], factor * lower[c]);
      }
    }
  }
};

template <class S, class In, class Of>
struct WeightGradient {
  In in;
  Of of_out;

  /// Sums over tiles blockIdx.y, blockIdx.y + gridDim.y, ... of all images.
  /// @param to  the layer's part of the block's row of partial sums
  __device__ void run(uint32_t* memory, uint32_t (*slots)[kWarps], const Tiles& tiles,
                      float* to) const {
    const int warp = threadIdx.x / 32;
    float total[S::kPerWarp][S::kColumns][4] = {};
    const int count = tiles.x * tiles.y * tiles.images;
    for (int tile = blockIdx.y; tile < count; tile += gridDim.y) {
      const int x0 = tile % tiles.x * kTileX, y0 = tile / tiles.x % tiles.y * kTileY;
      const int image = tile / (tiles.x * tiles.y);
      float inverse_in, inverse_out;
      __syncthreads();
      load(memory, slots, image, y0, x0, &inverse_in, &inverse_out);
      __syncthreads();
      if (warp * S::kPerWarp < S::kTiles) {
        const int high = min(in.size.height - y0, kHalfY);
        add_tile(memory, high, inverse_in, inverse_out, total);
      }
    }
    store(total, to);
  }

 private:
  __device__ void load(uint32_t* memory, uint32_t (*slots)[kWarps], int image, int y0, int x0,
                       float* inverse_in, float* inverse_out) const {
    constexpr int kReach = S::kKernel / 2;
    const Planes<In, S::kIn, S::kRead, S::kHigh> inputs{in,     image,    y0 - kReach, x0 - kReach,
                                                        memory, S::kWide, S::kPlane};
    const Planes<Of, S::kOut, kTileX, kHalfY> outputs{
        of_out, image, y0, x0, memory + S::kInWords, kTileX, S::kOutPlane};
    const float largest_in = inputs.largest(), largest_out = outputs.largest();
    const Scale of_in(block_largest<kThreads>(largest_in, slots[0]));
    const Scale of_gradient(block_largest<kThreads>(largest_out, slots[1]));
    inputs.store(of_in.factor);
    outputs.store(of_gradient.factor);
    if (S::kBias) {
      uint32_t* const ones = memory + S::kIn * S::kPlane;
      for (int i = threadIdx.x; i < kHalfY * S::kWide; i += kThreads) {
        ones[i] = kernel::to_halves(1.f, 1.f);
      }
    }
    *inverse_in = of_in.inverse;
    *inverse_out = of_gradient.inverse;
  }

  /// Offset of a row of the product in the input tile; rows past the last are unused.
  static __device__ int offset(int row) {
    constexpr int kArea = S::kKernel * S::kKernel;
    if (row >= S::kRows) return 0;
    const int tap = row % kArea;
    return row / kArea * S::kPlane + tap / S::kKernel * S::kWide + tap % S::kKernel;
  }

  /// @param high  rows of words that contain a pixel of the image
  __device__ void add_tile(const uint32_t* memory, int high, float inverse_in, float inverse_out,
                           float (&total)[S::kPerWarp][S::kColumns][4]) const {
    const int warp = threadIdx.x / 32, lane = threadIdx.x % 32;
    float sums[S::kPerWarp][S::kColumns][4] = {};
    int rows[S::kPerWarp][2], outputs[S::kColumns];
#pragma unroll
    for (int i = 0; i < 2 * S::kPerWarp; ++i) {
      rows[i / 2][i % 2] =
          offset((warp * S::kPerWarp + i / 2) * 16 + i % 2 * 8 + lane / 4) + lane % 4;
    }
#pragma unroll
    for (int n = 0; n < S::kColumns; ++n) {
      outputs[n] = S::kInWords + min(8 * n + lane / 4, S::kOut - 1) * S::kOutPlane + lane % 4;
    }
#pragma unroll 1
    for (int y = 0; y < high; ++y) {
#pragma unroll
      for (int x = 0; x < kTileX; x += 8) {
        multiply(memory + x, rows, outputs, sums);
      }
#pragma unroll
      for (int i = 0; i < 2 * S::kPerWarp; ++i) rows[i / 2][i % 2] += S::kWide;
#pragma unroll
      for (int n = 0; n < S::kColumns; ++n) outputs[n] += kTileX;
    }
#pragma unroll
    for (int i = 0; i < S::kPerWarp * S::kColumns * 4; ++i) {
      const int m = i / (4 * S::kColumns), n = i / 4 % S::kColumns, k = i % 4;
      const int row = (warp * S::kPerWarp + m) * 16 + k / 2 * 8 + lane / 4;
      const float sum = sums[m][n][k] * inverse_out;
      total[m][n][k] += row < S::kTaps ? sum * inverse_in : sum;
    }
  }

  /// 16 pixels.
  static __device__ __forceinline__ void multiply(const uint32_t* memory,
                                                  const int (&rows)[S::kPerWarp][2],
                                                  const int (&outputs)[S::kColumns],
                                                  float (&sums)[S::kPerWarp][S::kColumns][4]) {
    uint32_t gradients[S::kColumns][2];
#pragma unroll
    for (int i = 0; i < 2 * S::kColumns; ++i) {
      gradients[i / 2][i % 2] = memory[outputs[i / 2] + i % 2 * 4];
    }
#pragma unroll
    for (int m = 0; m < S::kPerWarp; ++m) {
      uint32_t pixels[4];
#pragma unroll
      for (int k = 0; k < 4; ++k) pixels[k] = memory[rows[m][k % 2] + k / 2 * 4];
#pragma unroll
      for (int n = 0; n < S::kColumns; ++n) {
        kernel::multiply_add_f16(sums[m][n], pixels, gradients[n]);
      }
    }
  }

  __device__ void store(const float (&total)[S::kPerWarp][S::kColumns][4], float* to) const {
    const int warp = threadIdx.x / 32, lane = threadIdx.x % 32;
#pragma unroll
    for (int i = 0; i < S::kPerWarp * S::kColumns * 4; ++i) {
      const int m = i / (4 * S::kColumns), n = i / 4 % S::kColumns, k = i % 4;
      const int row = (warp * S::kPerWarp + m) * 16 + k / 2 * 8 + lane / 4;
      const int o = 8 * n + 2 * (lane % 4) + k % 2;
      if (o >= S::kOut || row >= S::kRows) continue;
      to[row < S::kTaps ? o * S::kTaps + row : S::kOut * S::kTaps + o] = total[m][n][k];
    }
  }
};

using Event1Weights = Sizes<Event1, false>;
using Event2Weights = Sizes<Event2, false>;
using Image1Weights = Sizes<Image1, true>;
using Image2Weights = Sizes<Image2, true>;
using Head1Weights = Sizes<Head1, false>;
using Head2Weights = Sizes<Head2, false>;
using Head3Weights = Sizes<Head3, true>;

struct AllLayers {
  WeightGradient<Event1Weights, ImageSource<0>, GradientSource<true>> event1;
  WeightGradient<Event2Weights, ImageSource<0>, GradientSource<true>> event2;
  WeightGradient<Image1Weights, ImageSource<0>, GradientSource<true>> image1;
  WeightGradient<Image2Weights, ImageSource<0>, GradientSource<true>> image2;
  WeightGradient<Head1Weights, ImageSource<3>, GradientSource<true>> head1;
  WeightGradient<Head2Weights, ImageSource<0>, HeadGradientSource> head2;
  WeightGradient<Head3Weights, ImageSource<0>, GradientSource<false>> head3;
};

constexpr int kShared = std::max(
    {Event1Weights::kShared, Event2Weights::kShared, Image1Weights::kShared, Image2Weights::kShared,
     Head1Weights::kShared, Head2Weights::kShared, Head3Weights::kShared});

/// Offset of a layer's sums in a row of all layers' sums; past the last layer: their total number.
JADE_HD constexpr int begin_of(int layer) {
  const int weights[] = {Event1Weights::kWeights, Event2Weights::kWeights, Image1Weights::kWeights,
                         Image2Weights::kWeights, Head1Weights::kWeights,  Head2Weights::kWeights,
                         Head3Weights::kWeights};
  int begin = 0;
  for (int i = 0; i < layer; ++i) begin += weights[i];
  return begin;
}

/// Layers of a group, the longest first.
constexpr int layers_in(WeightGroup group) { return group == WeightGroup::kHeads ? 3 : 2; }
__device__ Layer layer_of(WeightGroup group, unsigned int index) {
  switch (group) {
    case WeightGroup::kHeads:
      return index == 0 ? kHead2 : index == 1 ? kHead1 : kHead3;
    case WeightGroup::kSecond:
      return index == 0 ? kEvent2 : kImage2;
    default:
      return index == 0 ? kEvent1 : kImage1;
  }
}

__global__ void __launch_bounds__(kThreads, 3)
    weight_gradient_kernel(AllLayers all, WeightGroup group, Tiles tiles, float* partial) {
  __shared__ __align__(16) uint32_t memory[kShared];
  __shared__ uint32_t slots[2][kWarps];
  float* const row = partial + int64_t{blockIdx.y} * begin_of(kLayers);
  switch (layer_of(group, blockIdx.x)) {
    case kEvent1:
      return all.event1.run(memory, slots, tiles, row + begin_of(kEvent1));
    case kEvent2:
      return all.event2.run(memory, slots, tiles, row + begin_of(kEvent2));
    case kImage1:
      return all.image1.run(memory, slots, tiles, row + begin_of(kImage1));
    case kImage2:
      return all.image2.run(memory, slots, tiles, row + begin_of(kImage2));
    case kHead1:
      return all.head1.run(memory, slots, tiles, row + begin_of(kHead1));
    case kHead2:
      return all.head2.run(memory, slots, tiles, row + begin_of(kHead2));
    default:
      return all.head3.run(memory, slots, tiles, row + begin_of(kHead3));
  }
}

constexpr int kSumColumns = 32, kSumRows = 16;

/// Column sums of [rows, columns], deterministic.
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

Tiles tiles_of(const Network& net) {
  return {static_cast<int>(kernel::block_count(net.width, kTileX)),
          static_cast<int>(kernel::block_count(net.height, kTileY)), net.batch};
}

}  // namespace

int64_t weight_count() { return begin_of(kLayers); }

int64_t weights_begin(Layer layer) { return begin_of(layer); }

int64_t partial_rows(const Network& net) {
  const Tiles tiles = tiles_of(net);
  return std::min(int64_t{tiles.x} * tiles.y * tiles.images, kMaxRows);
}

void weight_gradients(const Network& net, const NetworkGradient& of, WeightGroup group,
                      cudaStream_t stream) {
  const Size size{net.height, net.width};
  const int64_t second = 6 * size.plane();  // of the features: image2's
  const auto image = [&](const float* at, int channels) {
    return ImageSource<0>{size, at, channels};
  };
  const AllLayers layers{
      {image(net.input + 3 * size.plane(), kInputPlanes), {size, of.of_event1, net.event1, 16}},
      {image(net.event1, 16), {size, of.of_features, net.features, 14}},
      {image(net.input, kInputPlanes), {size, of.of_image1, net.image1, 10}},
      {image(net.image1, 10), {size, of.of_features + second, net.features + second, 14}},
      {{size, net.features, 14, net.input}, {size, of.of_head1, net.head1, 9}},
      {image(net.head1, 9), {size, of.of_logits, net.head2, net.weights[kHead3]}},
      {image(net.head2, 24), {size, of.of_logits, nullptr, 1}}};
  const dim3 grid(layers_in(group), static_cast<unsigned>(partial_rows(net)));
  weight_gradient_kernel<<<grid, kThreads, 0, stream>>>(layers, group, tiles_of(net), of.partial);
}

void sum_weights(const Network& net, const NetworkGradient& of, cudaStream_t stream) {
  column_sum_kernel<<<kernel::grid_size(weight_count(), kSumColumns), dim3(kSumColumns, kSumRows),
                      0, stream>>>(of.partial, partial_rows(net), begin_of(kLayers), of.of_weights);
}

}  // namespace jade::router::cuda
