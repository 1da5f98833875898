// SPDX-License-Identifier: Apache-2.0
#include "jade/response/lookup.h"

#include <ATen/Dispatch.h>
#include <ATen/Parallel.h>
#include <algorithm>
#include <torch/types.h>
#include <vector>

namespace jade::response::cpu {
namespace {

/// Fixed, so that sums over the image do not depend on the number of threads.
constexpr int64_t kChunks = 16;

template <class T>
struct Cell {
  int64_t index;
  T fraction;  ///< in [0,1] inside the table, beyond it outside
};

template <class T>
Cell<T> cell_of(T x) {
  constexpr T kPerUnit = static_cast<T>((kKnots - 1) / kResponseRange);
  const T t = x * kPerUnit;
  // Written so that NaN lands in the first cell.
  const T bounded = t > 0 ? std::min(t, static_cast<T>(kKnots - 2)) : T(0);
  const auto index = static_cast<int64_t>(static_cast<int32_t>(bounded));
  return {index, t - static_cast<T>(index)};
}

template <class T>
void lookup(const T* image, const T* table, T* out, int64_t begin, int64_t end, int64_t pixels,
            int64_t images, bool mean) {
  if (!mean) {
    for (int64_t i = begin; i < end; ++i) {
      const Cell<T> cell = cell_of(image[i]);
      out[i] = table[cell.index] + cell.fraction * (table[cell.index + 1] - table[cell.index]);
    }
    return;
  }
  std::fill(out + begin, out + end, T(0));
  const T share = T(1) / static_cast<T>(images);
  for (int64_t k = 0; k < images; ++k) {
    for (int64_t p = begin; p < end; ++p) {
      const Cell<T> cell = cell_of(image[k * pixels + p]);
      const T value =
          table[cell.index] + cell.fraction * (table[cell.index + 1] - table[cell.index]);
      out[p] += share * value;
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
void backward(const T* image, const T* table, const T* gradient, T share, int64_t pixels,
              int64_t begin, int64_t end, T* of_image, double* of_cells) {
  constexpr T kPerUnit = static_cast<T>((kKnots - 1) / kResponseRange);
  int64_t pixel = begin % pixels;
  for (int64_t i = begin; i < end; ++i) {
    const Cell<T> cell = cell_of(image[i]);
    const T g = gradient[pixel] * share;
    if (++pixel == pixels) pixel = 0;
    if (of_image != nullptr) {
      of_image[i] = g * (table[cell.index + 1] - table[cell.index]) * kPerUnit;
    }
    if (of_cells != nullptr) {
      of_cells[2 * cell.index] += static_cast<double>(g);
      of_cells[2 * cell.index + 1] += static_cast<double>(g * cell.fraction);
    }
  }
}

}  // namespace

torch::Tensor lookup(const Lookup& args) {
  const int64_t images = args.image.size(0);
  torch::Tensor out = args.mean ? torch::empty(args.image.sizes().slice(1), args.image.options())
                                : torch::empty_like(args.image);
  AT_DISPATCH_FLOATING_TYPES(args.image.scalar_type(), "lookup", [&] {
    at::parallel_for(0, out.numel(), 8192, [&](int64_t begin, int64_t end) {
      lookup(args.image.const_data_ptr<scalar_t>(), args.table.const_data_ptr<scalar_t>(),
             out.mutable_data_ptr<scalar_t>(), begin, end, out.numel(), images, args.mean);
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
    const auto share =
        static_cast<scalar_t>(args.mean ? 1.0 / static_cast<double>(args.image.size(0)) : 1.0);
    at::parallel_for(0, kChunks, 1, [&](int64_t first, int64_t last) {
      for (int64_t c = first; c < last; ++c) {
        backward(args.image.const_data_ptr<scalar_t>(), args.table.const_data_ptr<scalar_t>(),
                 gradient.const_data_ptr<scalar_t>(), share, pixels, c * chunk,
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
