// SPDX-License-Identifier: Apache-2.0
#include <ATen/Dispatch.h>
#include <ATen/Parallel.h>
#include <algorithm>
#include <torch/types.h>
#include <vector>

#include "jade/response/lookup.h"
#include "jade/response/lookup_band.h"

namespace jade::response {

const LookupKernelSet& lookup_kernels() {
  static constexpr kernel::IsaTable<LookupKernelSet> kTable = {
    &portable::kLookupKernels,
#if defined(__x86_64__)
    &avx2::kLookupKernels,
    &avx512::kLookupKernels,
#endif
  };
  return kTable.chosen();
}

namespace cpu {
namespace {

/// Constant, so that sums over the image do not depend on the number of threads.
constexpr int64_t kChunks = 16;

template <class T>
void lookup(const T* image, const T* table, T* out, int64_t begin, int64_t end, int64_t pixels,
            int64_t images, const T* weights) {
  const LookupKernels<T>& kernels = lookup_kernels().of<T>();
  if (weights == nullptr) {
    kernels.values({image + begin, table, end - begin, T(1)}, out + begin);
    return;
  }
  std::fill(out + begin, out + end, T(0));
  for (int64_t k = 0; k < images; ++k) {
    kernels.add_values({image + k * pixels + begin, table, end - begin, weights[k]}, out + begin);
  }
}

/// Converts gradient sums of the cells, [kKnots, 2] Σ g and Σ g · fraction, to the table's: each
/// cell gives 1 − fraction to its lower and fraction to its upper knot.
torch::Tensor knots_from_cells(const torch::Tensor& cells) {
  torch::Tensor knots = cells.select(1, 0) - cells.select(1, 1);
  knots.slice(0, 1).add_(cells.select(1, 1).slice(0, 0, -1));
  return knots;
}

/// Values [begin, end) of the image; the gradient's `pixels` values are reused for every image.
template <class T>
void backward(const T* image, const T* table, const T* gradient, const T* weights, int64_t pixels,
              int64_t begin, int64_t end, T* of_image, double* of_cells) {
  const LookupKernels<T>& kernels = lookup_kernels().of<T>();
  while (begin < end) {
    const int64_t k = begin / pixels, pixel = begin % pixels;
    const int64_t count = std::min(end - begin, pixels - pixel);
    kernels.gradients({image + begin, table, count, weights == nullptr ? T(1) : weights[k]},
                      gradient + pixel, of_image == nullptr ? nullptr : of_image + begin, of_cells);
    begin += count;
  }
}

torch::Tensor lookup_one(const Lookup& args, const torch::Tensor& table) {
  const int64_t images = args.image.size(0);
  const bool sums = args.weights.defined();
  torch::Tensor out = sums ? torch::empty(args.image.sizes().slice(1), args.image.options())
                           : torch::empty_like(args.image);
  AT_DISPATCH_FLOATING_TYPES(args.image.scalar_type(), "lookup", [&] {
    at::parallel_for(0, out.numel(), 8192, [&](int64_t begin, int64_t end) {
      lookup(args.image.const_data_ptr<scalar_t>(), table.const_data_ptr<scalar_t>(),
             out.mutable_data_ptr<scalar_t>(), begin, end, out.numel(), images,
             sums ? args.weights.const_data_ptr<scalar_t>() : nullptr);
    });
  });
  return out;
}

/// Writes the gradient of the image to of_image unless that is undefined.
/// @return the table's gradient if requested
torch::Tensor gradients_of_one(const Lookup& args, const torch::Tensor& table,
                               const torch::Tensor& gradient, const torch::Tensor& of_image,
                               bool wants_table) {
  torch::Tensor parts;
  if (wants_table) parts = torch::empty({kChunks, kKnots, 2}, torch::kFloat64);
  const int64_t count = args.image.numel();
  const int64_t chunk = (count + kChunks - 1) / kChunks;
  const int64_t pixels = std::max<int64_t>(1, gradient.numel());
  AT_DISPATCH_FLOATING_TYPES(args.image.scalar_type(), "lookup_backward", [&] {
    const scalar_t* const weights =
        args.weights.defined() ? args.weights.const_data_ptr<scalar_t>() : nullptr;
    at::parallel_for(0, kChunks, 1, [&](int64_t first, int64_t last) {
      for (int64_t c = first; c < last; ++c) {
        double* const cells =
            wants_table ? parts.mutable_data_ptr<double>() + c * 2 * kKnots : nullptr;
        // Each thread clears its own part, which is then in its cache.
        if (wants_table) std::fill_n(cells, 2 * kKnots, 0.0);
        backward(args.image.const_data_ptr<scalar_t>(), table.const_data_ptr<scalar_t>(),
                 gradient.const_data_ptr<scalar_t>(), weights, pixels, c * chunk,
                 std::min(count, (c + 1) * chunk),
                 of_image.defined() ? of_image.mutable_data_ptr<scalar_t>() : nullptr, cells);
      }
    });
  });
  if (!wants_table) return {};
  return knots_from_cells(parts.sum(0)).to(table.scalar_type());
}

}  // namespace

std::vector<torch::Tensor> lookup(const Lookups& args) {
  std::vector<torch::Tensor> out;
  for (const Lookup& each : args.images) out.push_back(lookup_one(each, args.table));
  return out;
}

LookupGradients lookup_backward(const Lookups& args, const std::vector<torch::Tensor>& gradients,
                                const LookupWanted& wanted) {
  LookupGradients result;
  result.images.resize(args.images.size());
  // In reverse order, like autograd's accumulation.
  for (size_t i = args.images.size(); i-- > 0;) {
    if (!gradients[i].defined()) continue;
    const Lookup& each = args.images[i];
    if (wanted.images[i]) result.images[i] = torch::empty_like(each.image);
    const torch::Tensor of_table =
        gradients_of_one(each, args.table, gradients[i], result.images[i], wanted.table);
    result.table = result.table.defined() ? result.table + of_table : of_table;
  }
  return result;
}

}  // namespace cpu
}  // namespace jade::response
