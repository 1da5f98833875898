// SPDX-License-Identifier: Apache-2.0
// Direct convolutions of few channels on the CPU, in bands of rows. Must not include torch: the
// kernels are compiled for several instruction sets, so all shared code is inlined.
#pragma once

#include <cstdint>

#include "jade/kernel/host_device.h"
#include "jade/kernel/isa.h"

namespace jade::router {

/// Kernels compute blocks of this many columns; a block may extend past the requested range.
constexpr int64_t kColumnStep = 16;

/// Planes with a border: rows −pad … height + pad − 1, columns −pad … at least width + pad + 15,
/// which the kernels read and write in steps of several columns.
template <class T>
struct Planes {
  T* data = nullptr;
  int64_t channels = 0, height = 0, width = 0, pad = 0;

  static JADE_HD int64_t stride(int64_t width, int64_t pad) {
    return (width + 2 * pad + 15) / 16 * 16 + 16;
  }
  JADE_HD int64_t stride() const { return stride(width, pad); }
  JADE_HD int64_t rows() const { return height + 2 * pad; }
  JADE_HD int64_t size() const { return channels * rows() * stride(); }
  /// Column 0 of a row.
  JADE_HD T* row(int64_t channel, int64_t y) const {
    return data + (channel * rows() + y + pad) * stride() + pad;
  }
  JADE_HD Planes slice(int64_t first, int64_t count) const {
    return {data + first * rows() * stride(), count, height, width, pad};
  }
};

struct Band {
  int64_t begin, end;  ///< rows
};

/// Output channels are computed in blocks that share their loads; as many as registers allow.
constexpr int64_t kMostBlock = 6;
struct Blocks {
  int64_t channels, count;
  JADE_HD Blocks(int64_t all, int64_t most) : channels(all), count((all + most - 1) / most) {}
  JADE_HD int64_t begin(int64_t block) const { return channels * block / count; }
};

/// out(o, y, x) = bias[o] + Σ w[o][i][dy][dx] in(i, y + dy − K/2, x + dx − K/2).
template <class T>
struct Convolution {
  Planes<T> in, out;
  const T* weights = nullptr;  ///< block after block as [in][K][K][block], see pack_weights()
  const T* bias = nullptr;     ///< null: none
  int64_t kernel = 1;          ///< K: 1, 3 or 5
  int64_t reach = 0;           ///< columns computed on either side of the image
  bool relu = false;
};

/// Reorders [out][in][K][K] for ConvKernels::convolve.
template <class T>
void pack_weights(const T* weights, int64_t out, int64_t in, int64_t kernel, T* packed) {
  const int64_t taps = in * kernel * kernel;
  const Blocks blocks(out, kMostBlock);
  for (int64_t block = 0; block < blocks.count; ++block) {
    const int64_t begin = blocks.begin(block), end = blocks.begin(block + 1);
    for (int64_t tap = 0; tap < taps; ++tap) {
      for (int64_t o = begin; o < end; ++o) *packed++ = weights[o * taps + tap];
    }
  }
}

/// Columns of the gradient from the width on must be zero, those of `in` finite.
template <class T>
struct WeightGradient {
  Planes<T> in, gradient;
  int64_t kernel = 1;
};

template <class T>
struct ConvKernels {
  /// Computes rows of the band, which may include the border. Columns beyond width + reach are
  /// overwritten.
  void (*convolve)(const Convolution<T>& convolution, Band band);
  /// Sums over the band's rows: of_weights[o][i][dy][dx] = Σ g(o, y, x) in(i, y + dy − K/2, …) and
  /// of_bias[o] = Σ g(o, y, x) unless null.
  void (*weight_gradient)(const WeightGradient<T>& args, Band band, T* of_weights, T* of_bias);
};
using ConvKernelSet = kernel::KernelSet<ConvKernels>;

namespace portable {
extern const ConvKernelSet kConvKernels;
}
namespace avx2 {
extern const ConvKernelSet kConvKernels;
}
namespace avx512 {
extern const ConvKernelSet kConvKernels;
}

/// The kernels for kernel::chosen_isa().
const ConvKernelSet& conv_kernels();

}  // namespace jade::router
