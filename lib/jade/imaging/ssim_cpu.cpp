// SPDX-License-Identifier: Apache-2.0
#include <ATen/Parallel.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <torch/types.h>
#include <vector>

#include "jade/imaging/ssim_band.h"
#include "jade/imaging/ssim_kernels.h"

namespace jade::imaging {

const double* ssim_window() {
  static const auto window = [] {
    std::array<double, kSsimTaps> taps{};
    double sum = 0;
    for (int k = 0; k < kSsimTaps; ++k) {
      const double distance = k - kSsimRadius;
      taps[size_t(k)] = std::exp(-distance * distance / (2 * 1.5 * 1.5));
      sum += taps[size_t(k)];
    }
    for (double& tap : taps) tap /= sum;
    return taps;
  }();
  return window.data();
}

const SsimKernelSet& ssim_kernels() {
  static constexpr kernel::IsaTable<SsimKernelSet> kTable = {
    &portable::kSsimKernels,
#if defined(__x86_64__)
    &avx2::kSsimKernels,
    &avx512::kSsimKernels,
#endif
  };
  return kTable.chosen();
}

namespace cpu {
namespace {

/// With fewer rows per band, filtering its neighbours' rows would dominate.
constexpr int64_t kLeastRows = 32;

/// Runs work(plane, first row, last row, scratch) over bands of rows, with an equal number of rows
/// per thread across all planes. Results are stored per row, so that they do not depend on the
/// number of threads.
template <class T, class Work>
void for_bands(const ImagePlanes& planes, const Work& work) {
  const int64_t threads = at::in_parallel_region() ? 1 : at::get_num_threads();
  const int64_t rows = planes.count * planes.height;
  const int64_t parts = std::clamp<int64_t>(threads, 1, std::max<int64_t>(1, rows / kLeastRows));
  at::parallel_for(0, parts, 1, [&](int64_t begin, int64_t end) {
    std::vector<T> scratch(size_t(ssim_scratch_size(planes.width)));
    const int64_t last = rows * end / parts;
    for (int64_t row = rows * begin / parts; row < last;) {
      const int64_t plane = row / planes.height, first = row % planes.height;
      const int64_t until = std::min(planes.height, first + last - row);
      work(plane, first, until, scratch.data());
      row += until - first;
    }
  });
}

/// A plane of the batch's images: which pair's, and where in it.
struct BatchPlane {
  size_t pair;
  int64_t offset;  ///< of its first pixel
};

std::vector<BatchPlane> planes_in(const SsimBatch& batch) {
  std::vector<BatchPlane> planes;
  for (size_t i = 0; i < batch.pairs.size(); ++i) {
    const ImagePlanes size = planes_of(batch.pairs[i].a);
    for (int64_t plane = 0; plane < size.count; ++plane) {
      planes.push_back({i, plane * size.height * size.width});
    }
  }
  return planes;
}

template <class T>
T* at_offset(T* data, int64_t offset) {
  return data == nullptr ? data : data + offset;
}

template <class T>
SsimBand<T> band_of(const SsimBatch& batch, const std::vector<torch::Tensor>& gradients,
                    const BatchPlane& plane) {
  const SsimPair& pair = batch.pairs[plane.pair];
  const auto count = double(pair.a.numel());
  SsimBand<T> band;
  band.a = pair.a.const_data_ptr<T>() + plane.offset;
  band.b = pair.b.const_data_ptr<T>() + plane.offset;
  band.mean_b = at_offset(read_or_null<T>(pair.mean_b), plane.offset);
  band.square_b = at_offset(read_or_null<T>(pair.square_b), plane.offset);
  band.height = pair.a.size(-2);
  band.width = pair.a.size(-1);
  band.weight_ssim = T(batch.weights.ssim / count);
  band.weight_l1 = T(batch.weights.l1 / count);
  band.grad_a = at_offset(write_or_null<T>(gradients[2 * plane.pair]), plane.offset);
  band.grad_b = at_offset(write_or_null<T>(gradients[2 * plane.pair + 1]), plane.offset);
  return band;
}

/// The factor of a term and of its gradients.
template <class T>
T factor_of(const SsimTerm& term) {
  return T(term.weight) * (term.scale.defined() ? T(term.scale.item<double>()) : T(1));
}

template <class T>
SsimValues summed(const SsimBatch& batch, const std::vector<T>& values) {
  const auto options = batch.pairs[0].a.options().requires_grad(false);
  SsimValues out{torch::empty({}, options),
                 torch::empty({static_cast<int64_t>(batch.terms.size())}, options),
                 {}};
  T* const terms = out.terms.mutable_data_ptr<T>();
  size_t pair = 0;
  T total = 0;
  for (size_t t = 0; t < batch.terms.size(); ++t) {
    T sum = values[pair++];
    for (int64_t i = 1; i < batch.terms[t].pairs; ++i) sum += values[pair++];
    terms[t] = sum * factor_of<T>(batch.terms[t]);
    total += terms[t];
  }
  *out.total.mutable_data_ptr<T>() = total;
  return out;
}

/// Computes the gradients in the same pass, while their inputs are in the cache.
template <class T>
SsimValues similarity_of(const SsimBatch& batch) {
  std::vector<torch::Tensor> gradients(2 * batch.pairs.size());
  for (size_t i = 0; i < batch.pairs.size(); ++i) {
    const SsimPair& pair = batch.pairs[i];
    if (pair.grad_a) gradients[2 * i] = torch::empty_like(pair.a);
    if (pair.grad_b) gradients[2 * i + 1] = torch::empty_like(pair.b);
  }
  const std::vector<BatchPlane> planes = planes_in(batch);
  ImagePlanes size = planes_of(batch.pairs[0].a);
  size.count = static_cast<int64_t>(planes.size());
  std::vector<double> ssim_sums(size_t(size.count * size.height)), l1_sums(ssim_sums.size());
  const SsimKernels<T>& kernels = ssim_kernels().of<T>();
  for_bands<T>(size, [&](int64_t plane, int64_t begin, int64_t end, T* scratch) {
    SsimBand<T> band = band_of<T>(batch, gradients, planes[size_t(plane)]);
    band.row_begin = begin;
    band.row_end = end;
    band.ssim_sums = ssim_sums.data() + plane * size.height;
    band.l1_sums = batch.weights.l1 != 0 ? l1_sums.data() + plane * size.height : nullptr;
    band.scratch = scratch;
    kernels.band(band, ssim_window());
  });
  std::vector<double> ssim_of(batch.pairs.size()), l1_of(batch.pairs.size());
  for (size_t row = 0; row < ssim_sums.size(); ++row) {
    const size_t pair = planes[row / size_t(size.height)].pair;
    ssim_of[pair] += ssim_sums[row];
    l1_of[pair] += l1_sums[row];
  }
  const SsimWeights& weights = batch.weights;
  std::vector<T> values;
  for (size_t i = 0; i < batch.pairs.size(); ++i) {
    const double sum = weights.ssim * ssim_of[i] + weights.l1 * l1_of[i];
    values.push_back(T(weights.offset + sum / double(batch.pairs[i].a.numel())));
  }
  SsimValues out = summed(batch, values);
  out.kept = std::move(gradients);
  return out;
}

template <class T>
std::vector<torch::Tensor> gradients_of(const SsimBatch& batch,
                                        const std::vector<torch::Tensor>& kept,
                                        const SsimUpstream& upstream) {
  std::vector<torch::Tensor> result(kept.size());
  size_t pair = 0;
  for (size_t t = 0; t < batch.terms.size(); ++t) {
    T factor = 0;
    if (upstream.total.defined()) factor += upstream.total.item<T>();
    if (upstream.terms.defined()) factor += upstream.terms[int64_t(t)].item<T>();
    factor *= factor_of<T>(batch.terms[t]);
    for (int64_t i = 0; i < batch.terms[t].pairs; ++i, ++pair) {
      for (const size_t each : {2 * pair, 2 * pair + 1}) {
        if (!kept[each].defined()) continue;
        result[each] = factor == T(1) ? kept[each] : kept[each] * double(factor);
      }
    }
  }
  return result;
}

template <class T>
void means_of(const torch::Tensor& image, torch::Tensor& mean, torch::Tensor& square) {
  const ImagePlanes planes = planes_of(image);
  const int64_t pixels = planes.height * planes.width;
  const T* data = image.const_data_ptr<T>();
  T *mean_data = mean.mutable_data_ptr<T>(), *square_data = square.mutable_data_ptr<T>();
  const SsimKernels<T>& kernels = ssim_kernels().of<T>();
  for_bands<T>(planes, [&](int64_t plane, int64_t begin, int64_t end, T* scratch) {
    SsimBand<T> band;
    band.b = data + plane * pixels;
    band.height = planes.height;
    band.width = planes.width;
    band.row_begin = begin;
    band.row_end = end;
    band.scratch = scratch;
    kernels.moments(band, ssim_window(), mean_data + plane * pixels, square_data + plane * pixels);
  });
}

}  // namespace

SsimValues similarity(const SsimBatch& batch) {
  return batch.pairs[0].a.scalar_type() == torch::kFloat32 ? similarity_of<float>(batch)
                                                           : similarity_of<double>(batch);
}

std::vector<torch::Tensor> similarity_gradients(const SsimBatch& batch,
                                                const std::vector<torch::Tensor>& kept,
                                                const SsimUpstream& upstream) {
  return batch.pairs[0].a.scalar_type() == torch::kFloat32
             ? gradients_of<float>(batch, kept, upstream)
             : gradients_of<double>(batch, kept, upstream);
}

void window_means(const torch::Tensor& image, torch::Tensor& mean, torch::Tensor& square) {
  image.scalar_type() == torch::kFloat32 ? means_of<float>(image, mean, square)
                                         : means_of<double>(image, mean, square);
}

}  // namespace cpu
}  // namespace jade::imaging
