// SPDX-License-Identifier: Apache-2.0
#include <ATen/Dispatch.h>
#include <ATen/Parallel.h>
#include <algorithm>
#include <torch/types.h>
#include <vector>

#include "jade/response/lookup_math.h"

namespace jade::response::cpu {
namespace {

/// Fixed, so that sums over the image do not depend on the number of threads.
constexpr int64_t kChunks = 16;

template <class T>
T value_at(T x, const T* table) {
  const Cell<T> cell = cell_of(x);
  return interpolate(cell, table[cell.index], table[cell.index + 1]);
}

template <class T>
void lookup(const T* image, const T* table, T* out, int64_t begin, int64_t end, int64_t pixels,
            int64_t images, const T* weights) {
  if (weights == nullptr) {
    for (int64_t i = begin; i < end; ++i) out[i] = value_at(image[i], table);
    return;
  }
  std::fill(out + begin, out + end, T(0));
  for (int64_t k = 0; k < images; ++k) {
    for (int64_t p = begin; p < end; ++p) {
      out[p] += weights[k] * value_at(image[k * pixels + p], table);
    }
  }
}

/// Gradient sums of the cells, [kKnots, 2] Σ g and Σ g · fraction, as the table's: each cell
/// gives 1 − fraction to its lower and fraction to its upper knot.
torch::Tensor knots_from_cells(const torch::Tensor& cells) {
  torch::Tensor knots = cells.select(1, 0) - cells.select(1, 1);
  knots.slice(0, 1).add_(cells.select(1, 1).slice(0, 0, -1));
  return knots;
}

/// Values [begin, end) of the image; the gradient's `pixels` values serve one image after another.
template <class T>
void backward(const T* image, const T* table, const T* gradient, const T* weights, int64_t pixels,
              int64_t begin, int64_t end, T* of_image, double* of_cells) {
  int64_t pixel = begin % pixels, k = begin / pixels;
  for (int64_t i = begin; i < end; ++i) {
    const Cell<T> cell = cell_of(image[i]);
    const T g = weights == nullptr ? gradient[pixel] : gradient[pixel] * weights[k];
    if (++pixel == pixels) pixel = 0, ++k;
    if (of_image != nullptr) {
      of_image[i] = gradient_of_x(g, table[cell.index], table[cell.index + 1]);
    }
    if (of_cells != nullptr) {
      of_cells[2 * cell.index] += static_cast<double>(g);
      of_cells[2 * cell.index + 1] += static_cast<double>(gradient_of_upper(cell, g));
    }
  }
}

}  // namespace

torch::Tensor lookup(const Lookup& args) {
  const int64_t images = args.image.size(0);
  const bool sums = args.weights.defined();
  torch::Tensor out = sums ? torch::empty(args.image.sizes().slice(1), args.image.options())
                           : torch::empty_like(args.image);
  AT_DISPATCH_FLOATING_TYPES(args.image.scalar_type(), "lookup", [&] {
    at::parallel_for(0, out.numel(), 8192, [&](int64_t begin, int64_t end) {
      lookup(args.image.const_data_ptr<scalar_t>(), args.table.const_data_ptr<scalar_t>(),
             out.mutable_data_ptr<scalar_t>(), begin, end, out.numel(), images,
             sums ? args.weights.const_data_ptr<scalar_t>() : nullptr);
    });
  });
  return out;
}

LookupGradient lookup_backward(const Lookup& args, const torch::Tensor& gradient, bool wants_image,
                               bool wants_table) {
  LookupGradient result;
  if (wants_image) result.image = torch::empty_like(args.image);
  torch::Tensor parts;
  if (wants_table) parts = torch::zeros({kChunks, kKnots, 2}, torch::kFloat64);
  const int64_t count = args.image.numel();
  const int64_t chunk = (count + kChunks - 1) / kChunks;
  const int64_t pixels = std::max<int64_t>(1, gradient.numel());
  AT_DISPATCH_FLOATING_TYPES(args.image.scalar_type(), "lookup_backward", [&] {
    const scalar_t* const weights =
        args.weights.defined() ? args.weights.const_data_ptr<scalar_t>() : nullptr;
    at::parallel_for(0, kChunks, 1, [&](int64_t first, int64_t last) {
      for (int64_t c = first; c < last; ++c) {
        backward(args.image.const_data_ptr<scalar_t>(), args.table.const_data_ptr<scalar_t>(),
                 gradient.const_data_ptr<scalar_t>(), weights, pixels, c * chunk,
                 std::min(count, (c + 1) * chunk),
                 wants_image ? result.image.mutable_data_ptr<scalar_t>() : nullptr,
                 wants_table ? parts.mutable_data_ptr<double>() + c * 2 * kKnots : nullptr);
      }
    });
  });
  if (wants_table) result.table = knots_from_cells(parts.sum(0)).to(args.table.scalar_type());
  return result;
}

}  // namespace jade::response::cpu
