// SPDX-License-Identifier: Apache-2.0
// Sums stay in registers: twelve in a convolution, about ten in a weight gradient (twenty for the
// 5x5 layers if there are 32 registers), which saves two or three loads per multiplication. Uses
// the compiler's vector extensions. Sums over columns always use vectors of 32 bytes, so that every
// machine adds in the same order; the columns of a convolution are independent. Compiled once per
// instruction set by jade_add_isa_sources().
#pragma once

#include <cstring>

#include "jade/router/conv_band.h"

namespace jade::router {
namespace JADE_ISA {

constexpr int kSumBytes = 32;
constexpr int kColumnBytes = JADE_VECTOR_BYTES > kSumBytes ? JADE_VECTOR_BYTES : kSumBytes;
constexpr bool kManyRegisters = JADE_VECTOR_BYTES == 64;

template <class T, int Bytes = kSumBytes>
struct Vector {
  typedef T Type __attribute__((vector_size(Bytes)));
  static constexpr int kLanes = Bytes / sizeof(T);
};

template <class V, class T>
JADE_HD void load(V& v, const T* p) {
  std::memcpy(&v, p, sizeof(v));
}

/// `Count` vectors of columns of one row, B output channels from `first` on.
template <class T, int K, int B, int Count>
JADE_HD void convolve_columns(const Convolution<T>& args, const T* weights, int64_t first,
                              int64_t y, int64_t x) {
  using V = typename Vector<T, kColumnBytes>::Type;
  constexpr int kLanes = Vector<T, kColumnBytes>::kLanes;
  V sums[B][Count];
#pragma GCC unroll 8
  for (int o = 0; o < B; ++o) {
#pragma GCC unroll 2
    for (int part = 0; part < Count; ++part) {
      sums[o][part] = V{} + (args.bias != nullptr ? args.bias[first + o] : T(0));
    }
  }
  for (int64_t i = 0; i < args.in.channels; ++i) {
    const T* in = args.in.row(i, y - K / 2) + x - K / 2;
    for (int dy = 0; dy < K; ++dy, in += args.in.stride()) {
#pragma GCC unroll 8
      for (int dx = 0; dx < K; ++dx) {
        V values[Count];
#pragma GCC unroll 2
        for (int part = 0; part < Count; ++part) load(values[part], in + dx + part * kLanes);
#pragma GCC unroll 8
        for (int o = 0; o < B; ++o) {
          const V weight = V{} + weights[dx * B + o];
#pragma GCC unroll 2
          for (int part = 0; part < Count; ++part) sums[o][part] += weight * values[part];
        }
      }
      weights += K * B;
    }
  }
#pragma GCC unroll 8
  for (int o = 0; o < B; ++o) {
#pragma GCC unroll 2
    for (int part = 0; part < Count; ++part) {
      V& sum = sums[o][part];
      // Written so that NaN is preserved.
      if (args.relu) sum = sum < V{} ? V{} : sum;
      std::memcpy(args.out.row(first + o, y) + x + part * kLanes, &sum, sizeof(V));
    }
  }
}

template <class T, int K, int B>
JADE_HD void convolve_block(const Convolution<T>& args, const T* weights, int64_t first,
                            Band band) {
  constexpr int kLanes = Vector<T, kColumnBytes>::kLanes;
  const int64_t end = args.out.width + args.reach;
  for (int64_t y = band.begin; y < band.end; ++y) {
    int64_t x = -args.reach;
    for (; x + 2 * kLanes - kColumnStep < end; x += 2 * kLanes) {
      convolve_columns<T, K, B, 2>(args, weights, first, y, x);
    }
    for (; x < end; x += kLanes) convolve_columns<T, K, B, 1>(args, weights, first, y, x);
  }
}

template <class T, int K>
JADE_HD void convolve_kernel(const Convolution<T>& args, Band band) {
  const Blocks blocks(args.out.channels, kMostBlock);
  for (int64_t block = 0; block < blocks.count; ++block) {
    const int64_t first = blocks.begin(block);
    const T* const weights = args.weights + first * args.in.channels * K * K;
    switch (blocks.begin(block + 1) - first) {
      case 1:
        convolve_block<T, K, 1>(args, weights, first, band);
        break;
      case 2:
        convolve_block<T, K, 2>(args, weights, first, band);
        break;
      case 3:
        convolve_block<T, K, 3>(args, weights, first, band);
        break;
      case 4:
        convolve_block<T, K, 4>(args, weights, first, band);
        break;
      case 5:
        convolve_block<T, K, 5>(args, weights, first, band);
        break;
      default:
        convolve_block<T, K, 6>(args, weights, first, band);
    }
  }
}

template <class T>
void convolve_any(const Convolution<T>& args, Band band) {
  switch (args.kernel) {
    case 1:
      convolve_kernel<T, 1>(args, band);
      break;
    case 3:
      convolve_kernel<T, 3>(args, band);
      break;
    default:
      convolve_kernel<T, 5>(args, band);
  }
}

template <class T>
JADE_HD T sum_lanes(const typename Vector<T>::Type& v) {
  T sum = 0;
  for (int lane = 0; lane < Vector<T>::kLanes; ++lane) sum += v[lane];
  return sum;
}

/// One row of taps of B output channels and one input channel.
template <class T, int K, int B>
JADE_HD void tap_row(const WeightGradient<T>& args, int64_t first, int64_t i, int dy, Band band,
                     T* of_weights) {
  using V = typename Vector<T>::Type;
  V sums[B][K] = {};
  for (int64_t y = band.begin; y < band.end; ++y) {
    const T* const in = args.in.row(i, y + dy - K / 2) - K / 2;
    const T* const gradient = args.gradient.row(first, y);
    const int64_t plane = args.gradient.rows() * args.gradient.stride();
    for (int64_t x = 0; x < args.gradient.width; x += Vector<T>::kLanes) {
      V g[B];
#pragma GCC unroll 8
      for (int o = 0; o < B; ++o) load(g[o], gradient + o * plane + x);
#pragma GCC unroll 8
      for (int dx = 0; dx < K; ++dx) {
        V value;
        load(value, in + x + dx);
#pragma GCC unroll 8
        for (int o = 0; o < B; ++o) sums[o][dx] += g[o] * value;
      }
    }
  }
  for (int o = 0; o < B; ++o) {
    T* const out = of_weights + ((first + o) * args.in.channels + i) * K * K + dy * K;
    for (int dx = 0; dx < K; ++dx) out[dx] = sum_lanes<T>(sums[o][dx]);
  }
}

template <class T, int K, int B>
JADE_HD void weights_block(const WeightGradient<T>& args, int64_t first, Band band, T* of_weights) {
  for (int64_t i = 0; i < args.in.channels; ++i) {
    for (int dy = 0; dy < K; ++dy) tap_row<T, K, B>(args, first, i, dy, band, of_weights);
  }
}

template <class T, int K>
JADE_HD void weights_kernel(const WeightGradient<T>& args, Band band, T* of_weights) {
  constexpr int kMost = K != 5 ? 3 : kManyRegisters ? 4 : 2;
  const Blocks blocks(args.gradient.channels, kMost);
  for (int64_t block = 0; block < blocks.count; ++block) {
    const int64_t first = blocks.begin(block);
    switch (blocks.begin(block + 1) - first) {
      case 1:
        weights_block<T, K, 1>(args, first, band, of_weights);
        break;
      case 2:
        weights_block<T, K, 2>(args, first, band, of_weights);
        break;
      case 3:
        weights_block < T, K, kMost<3 ? kMost : 3>(args, first, band, of_weights);
        break;
      default:
        weights_block<T, K, kMost>(args, first, band, of_weights);
    }
  }
}

template <class T>
JADE_HD void bias_sums(const WeightGradient<T>& args, Band band, T* of_bias) {
  using V = typename Vector<T>::Type;
  for (int64_t o = 0; o < args.gradient.channels; ++o) {
    V sum{};
    for (int64_t y = band.begin; y < band.end; ++y) {
      const T* const row = args.gradient.row(o, y);
      for (int64_t x = 0; x < args.gradient.width; x += Vector<T>::kLanes) {
        V g;
        load(g, row + x);
        sum += g;
      }
    }
    of_bias[o] = sum_lanes<T>(sum);
  }
}

template <class T>
void weights_any(const WeightGradient<T>& args, Band band, T* of_weights, T* of_bias) {
  switch (args.kernel) {
    case 1:
      weights_kernel<T, 1>(args, band, of_weights);
      break;
    case 3:
      weights_kernel<T, 3>(args, band, of_weights);
      break;
    default:
      weights_kernel<T, 5>(args, band, of_weights);
  }
  if (of_bias != nullptr) bias_sums(args, band, of_bias);
}

const ConvKernelSet kConvKernels = {{convolve_any<float>, weights_any<float>},
                                    {convolve_any<double>, weights_any<double>}};

}  // namespace JADE_ISA
}  // namespace jade::router
