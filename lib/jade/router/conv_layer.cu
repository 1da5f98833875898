// SPDX-License-Identifier: Apache-2.0
// Convolutions as matrix products: pixels x output channels, summed over (input channel, tap).
#include "jade/kernel/launch.h"
#include "jade/router/conv_layer.h"
#include "jade/router/conv_shape.cuh"

namespace jade::router::cuda {
namespace {

constexpr int kThreads = 128;
constexpr int kRows = 2;  ///< of a warp's tile, 32 pixels each: two products wide

/// Part of [0, size) that a tile covers. `border` replicated pixels at either end are in the same
/// tile as the edge pixel that they repeat.
struct Span {
  int begin, end;
  bool at_begin, at_end;
  __device__ Span(int tile, int step, int size, int border) {
    const int last = (size - 1) / step;
    const int last_begin = min(last * step, size - border - 1);
    begin = tile == last ? last_begin : tile * step;
    end = tile == last ? size : min(begin + step, tile + 1 == last ? last_begin : size);
    at_begin = tile == 0;
    at_end = tile == last;
  }
};

/// Stores the sums of a pixel, with `stride` between them.
struct Store {
  float* to;          ///< [N,channels,H,W]; may start at a later channel
  int channels;       ///< of the tensor
  const float* bias;  ///< null: none
  bool relu, add;

  template <int OUT>
  __device__ void put(int image, int64_t plane, int offset, const float* sums, int stride) const {
    float* at = to + image * channels * plane + offset;
#pragma unroll
    for (int o = 0; o < OUT; ++o) {
      float value = sums[o * stride];
      if (bias != nullptr) value += __ldg(bias + o);
      if (relu) value = fmaxf(value, 0.f);
      if (add) value += *at;
      *at = value;
      at += plane;
    }
  }
};

/// head2's ReLU and all of head3.
struct StoreLogits {
  float* head2;  ///< null: not stored
  const float *weights, *bias;
  float* logits;

  template <int OUT>
  __device__ void put(int image, int64_t plane, int offset, const float* sums, int stride) const {
    float* kept = head2 + image * OUT * plane + offset;
    float logit = 0;
#pragma unroll
    for (int o = 0; o < OUT; ++o) {
      const float value = fmaxf(sums[o * stride], 0.f);
      if (head2 != nullptr) *kept = value;
      kept += plane;
      logit += __ldg(weights + o) * value;
    }
    logits[image * plane + offset] = logit + __ldg(bias);
  }
};

/// Sums of a warp's pixels.
template <int COLUMNS>
using Sums = float[kRows][2][COLUMNS][4];

/// out(o, y, x) = Σ w(o, i, dy, dx) source(i, y + dy, x + dx). TURNED: the gradient of a layer's
/// input, whose replicated border is added to the edge.
template <class S, bool TURNED, class Source, class Finish>
struct Convolution {
  static constexpr int kBorder = TURNED ? S::kKernel / 2 : 0;
  static constexpr int kOutPlane = kTileX * kTileY + 4;
  static constexpr int kShared = S::kOut * kOutPlane > S::kWords ? S::kOut* kOutPlane : S::kWords;
  Source source;
  Finish finish;
  const uint2* fragments;
  const uint32_t* inverse;

  dim3 grid(int batch) const {
    return dim3(kernel::grid_size(source.size.width + 2 * kBorder, kTileX),
                kernel::grid_size(source.size.height + 2 * kBorder, kTileY), batch);
  }

  /// @param memory  kShared words
  __device__ void run(uint32_t* memory, uint32_t* slots, int tile) const {
    const Span x(tile, kTileX, source.size.width + 2 * kBorder, kBorder);
    const Span y(blockIdx.y, kTileY, source.size.height + 2 * kBorder, kBorder);
    const float inverse_scale = load(memory, slots, y.begin, x.begin);
    __syncthreads();
    Sums<S::kColumns> sums = {};
    if (y.begin + static_cast<int>(threadIdx.x) / 32 * kRows < y.end) multiply(memory, sums);
    __syncthreads();
    float* const out = reinterpret_cast<float*>(memory);
    spill(sums, inverse_scale, out);
    __syncthreads();
    if (TURNED) fold(out, y, x);
    store(out, y, x);
  }

 private:
  /// Returns 1 / the scale of the tile.
  __device__ float load(uint32_t* memory, uint32_t* slots, int y0, int x0) const {
    constexpr int kRounds = round_up(S::kPixels, kThreads) / kThreads;
    constexpr int kReach = TURNED ? S::kKernel - 1 : S::kKernel / 2;
    float values[kRounds][S::kIn];
    float largest = 0;
#pragma unroll
    for (int round = 0; round < kRounds; ++round) {
      const int pixel = threadIdx.x + round * kThreads;
      if (pixel >= S::kPixels) continue;
      source.read(blockIdx.z, y0 - kReach + pixel / S::kWide, x0 - kReach + pixel % S::kWide,
                  values[round]);
      largest = fmaxf(largest, largest_of(values[round]));
    }
    const Scale scale(block_largest<kThreads>(largest, slots));
#pragma unroll
    for (int round = 0; round < kRounds; ++round) {
      const int pixel = threadIdx.x + round * kThreads;
      if (pixel >= S::kPixels) continue;
      uint32_t* const to = memory + pixel * S::kStride;
#pragma unroll
      for (int pair = 0; pair < S::kPairs; ++pair) {
        const float second = 2 * pair + 1 < S::kIn ? values[round][2 * pair + 1] : 0.f;
        to[pair] = kernel::to_halves(scale.factor * values[round][2 * pair], scale.factor * second);
      }
      // Values that are multiplied by zero weights must be finite.
      for (int pair = S::kPairs; pair < S::kStride; ++pair) to[pair] = 0;
    }
    if constexpr (S::kBehind > 0) {
      if (threadIdx.x < S::kBehind) memory[S::kPixels * S::kStride + threadIdx.x] = 0;
    }
    return scale.inverse;
  }

  /// Column of a product's row `lane / 4 + 8 · half`.
  static __device__ constexpr int column(int product, int half, int row) {
    return S::kSpread ? 4 * row + 2 * product + half : 16 * product + 8 * half + row;
  }

  /// Each row of the tile is read once and multiplied with all kernel rows that overlap it.
  __device__ void multiply(const uint32_t* memory, Sums<S::kColumns>& sums) const {
    constexpr int kKernel = S::kKernel, kColumns = S::kColumns;
    const int warp = threadIdx.x / 32, lane = threadIdx.x % 32;
    const uint32_t* from =
        memory + (kRows * warp * S::kWide + column(0, 0, lane / 4)) * S::kStride + lane % 4;
    const uint2* weights = fragments + lane;
#pragma unroll 1
    for (int step = 0; step < S::kSteps; ++step) {
      uint2 w[kKernel][kColumns];
#pragma unroll
      for (int i = 0; i < kKernel * kColumns; ++i) {
        w[i / kColumns][i % kColumns] = __ldg(weights + i * 32);
      }
#pragma unroll
      for (int i = 0; i < 2 * (kRows + kKernel - 1); ++i) {
        const int row = i / 2, product = i % 2;
        uint32_t pixels[4];
#pragma unroll
        for (int k = 0; k < 4; ++k) {
          pixels[k] = from[(row * S::kWide + column(product, k % 2, 0)) * S::kStride + 4 * (k / 2)];
        }
#pragma unroll
        for (int y = 0; y < kRows; ++y) {
          const int dy = row - y;
          if (dy < 0 || dy >= kKernel) continue;
#pragma unroll
          for (int n = 0; n < kColumns; ++n) {
            const uint32_t taps[2] = {w[dy][n].x, w[dy][n].y};
            kernel::multiply_add_f16(sums[y][product][n], pixels, taps);
          }
        }
      }
      from += S::kAdvance;
      weights += kKernel * kColumns * 32;
    }
  }

  /// The sums as [output][row][column].
  __device__ void spill(const Sums<S::kColumns>& sums, float inverse_scale, float* out) const {
    const int warp = threadIdx.x / 32, lane = threadIdx.x % 32;
    const float inverse_weights = __uint_as_float(__ldg(inverse));
#pragma unroll
    for (int i = 0; i < kRows * S::kColumns * 2; ++i) {
      const int y = i / (2 * S::kColumns), n = i / 2 % S::kColumns, odd = i % 2;
      const int o = 8 * n + 2 * (lane % 4) + odd;
      if (o >= S::kOut) continue;
      float values[4];
#pragma unroll
      for (int k = 0; k < 4; ++k) {
        values[k] = sums[y][k / 2][n][k % 2 * 2 + odd] * inverse_scale * inverse_weights;
      }
      float* const to = out + o * kOutPlane + (kRows * warp + y) * kTileX + column(0, 0, lane / 4);
      if (S::kSpread) {
        *reinterpret_cast<float4*>(to) = make_float4(values[0], values[1], values[2], values[3]);
      } else {
#pragma unroll
        for (int k = 0; k < 4; ++k) to[8 * k] = values[k];
      }
    }
  }

  /// Adds the gradients of the replicated border to its edge, in x, then in y.
  __device__ void fold(float* out, const Span& y, const Span& x) const {
    if (x.at_begin || x.at_end) {
      for (int i = threadIdx.x; i < S::kOut * kTileY; i += kThreads) {
        fold_line(out + i / kTileY * kOutPlane + i % kTileY * kTileX, 1, x);
      }
      __syncthreads();
    }
    if (y.at_begin || y.at_end) {
      for (int i = threadIdx.x; i < S::kOut * kTileX; i += kThreads) {
        fold_line(out + i / kTileX * kOutPlane + i % kTileX, kTileX, y);
      }
      __syncthreads();
    }
  }

  static __device__ void fold_line(float* line, int step, const Span& span) {
    const int last = span.end - span.begin - 1;
#pragma unroll
    for (int i = 0; i < kBorder; ++i) {
      if (span.at_begin) line[kBorder * step] += line[i * step];
    }
#pragma unroll
    for (int i = 0; i < kBorder; ++i) {
      if (span.at_end) line[(last - kBorder) * step] += line[(last - i) * step];
    }
  }

  __device__ void store(const float* out, const Span& y, const Span& x) const {
    const Size& size = source.size;
    for (int pixel = threadIdx.x; pixel < kTileX * kTileY; pixel += kThreads) {
      const int padded_y = y.begin + pixel / kTileX, padded_x = x.begin + pixel % kTileX;
      if (padded_y >= y.end || padded_x >= x.end) continue;
      const int out_y = padded_y - kBorder, out_x = padded_x - kBorder;
      if (!size.has(out_y, out_x)) continue;
      finish.template put<S::kOut>(blockIdx.z, size.plane(), out_y * size.width + out_x,
                                   out + pixel, kOutPlane);
    }
  }
};

/// Blocks per multiprocessor: a small image has three.
constexpr int kResident = 3;

template <class A>
__global__ void __launch_bounds__(kThreads, kResident) convolve_kernel(A a) {
  __shared__ __align__(16) uint32_t memory[A::kShared];
  __shared__ uint32_t slots[kThreads / 32];
  a.run(memory, slots, blockIdx.x);
}

/// Two convolutions of the same size.
template <class A, class B>
__global__ void __launch_bounds__(kThreads, kResident + 1)
    convolve_both_kernel(A a, B b, int tiles) {
  __shared__ __align__(16) uint32_t memory[A::kShared > B::kShared ? A::kShared : B::kShared];
  __shared__ uint32_t slots[kThreads / 32];
  if (static_cast<int>(blockIdx.x) < tiles) {
    a.run(memory, slots, blockIdx.x);
  } else {
    b.run(memory, slots, blockIdx.x - tiles);
  }
}

/// Selects a product's weights, and launches kernels on a stream.
struct Run {
  const Network& network;
  cudaStream_t stream;

  template <class S, bool TURNED = false, class Source, class Finish>
  Convolution<S, TURNED, Source, Finish> make(int product, const Source& source,
                                              const Finish& finish) const {
    return {source, finish,
            reinterpret_cast<const uint2*>(network.prepared) + kPlans.of[product].begin,
            network.prepared + product};
  }
  template <class A>
  void operator()(const A& a) const {
    convolve_kernel<A><<<a.grid(network.batch), kThreads, 0, stream>>>(a);
  }
  template <class A, class B>
  void operator()(const A& a, const B& b) const {
    dim3 grid = a.grid(network.batch);
    const int tiles = static_cast<int>(grid.x);
    grid.x *= 2;
    convolve_both_kernel<A, B><<<grid, kThreads, 0, stream>>>(a, b, tiles);
  }
};

}  // namespace

void forward(const Network& net, cudaStream_t stream) {
  prepare_weights(net, stream);
  const Run run{net, stream};
  const Size size{net.height, net.width};
  const int64_t plane = int64_t{net.height} * net.width;
  using Image = ImageSource<0>;
  run(run.make<Image1>(kImage1, Image{size, net.input, kInputPlanes},
                       Store{net.image1, 10, net.bias[kImage1], true, false}),
      run.make<Event1>(kEvent1, Image{size, net.input + 3 * plane, kInputPlanes},
                       Store{net.event1, 16, nullptr, true, false}));
  run(run.make<Event2>(kEvent2, Image{size, net.event1, 16},
                       Store{net.features, 14, nullptr, true, false}),
      run.make<Image2>(kImage2, Image{size, net.image1, 10},
                       Store{net.features + 6 * plane, 14, net.bias[kImage2], true, false}));
  run(run.make<Head1>(kHead1, ImageSource<3>{size, net.features, 14, net.input},
                      Store{net.head1, 9, nullptr, true, false}));
  run(run.make<Head2>(kHead2, Image{size, net.head1, 9},
                      StoreLogits{net.head2, net.weights[kHead3], net.bias[kHead3], net.logits}));
}

void backward(const Network& net, const NetworkGradient& of, cudaStream_t stream,
              const Beside& beside) {
  const Run run{net, stream};
  const Size size{net.height, net.width};
  const int64_t plane = int64_t{net.height} * net.width;
  const auto to = [](float* at, int channels, bool add = false) {
    return Store{at, channels, nullptr, false, add};
  };
  const HeadGradientSource head2{size, of.of_logits, net.head2, net.weights[kHead3]};
  const GradientSource<true> head1{size, of.of_head1, net.head1, 9};
  const GradientSource<true> event2{size, of.of_features, net.features, 14};
  const GradientSource<true> image2{size, of.of_features + 6 * plane, net.features + 6 * plane, 14};
  const GradientSource<true> event1{size, of.of_event1, net.event1, 16};
  const GradientSource<true> image1{size, of.of_image1, net.image1, 10};
  run(run.make<OfHead1, true>(kOfHead1, head2, to(of.of_head1, 9)));
  beside([&](cudaStream_t other) { weight_gradients(net, of, WeightGroup::kHeads, other); });
  run(run.make<OfFeatures, true>(kOfFeatures, head1, to(of.of_features, 14)));
  beside([&](cudaStream_t other) { weight_gradients(net, of, WeightGroup::kSecond, other); });
  run(run.make<OfImage1, true>(kOfImage1, image2, to(of.of_image1, 10)),
      run.make<OfEvent1, true>(kOfEvent1, event2, to(of.of_event1, 16)));
  weight_gradients(net, of, WeightGroup::kFirst, stream);
  if (of.of_input == nullptr) return;
  run(run.make<HeadOfBlurry, true>(kHeadOfBlurry, head1, to(of.of_input, kInputPlanes)));
  run(run.make<OfBlurry, true>(kOfBlurry, image1, to(of.of_input, kInputPlanes, true)));
  run(run.make<OfPsi, true>(kOfPsi, event1, to(of.of_input + 3 * plane, kInputPlanes)));
}

}  // namespace jade::router::cuda
