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
#endif
  };
  return kTable.chosen();
}

namespace cpu {
namespace {

/// Runs work(plane, first row, last row, scratch) over bands of rows. Results are kept a row, so
/// that the division, which depends on the threads, does not show.
template <class T, class Work>
void for_bands(const ImagePlanes& planes, const Work& work) {
  const int64_t threads = at::in_parallel_region() ? 1 : at::get_num_threads();
  const int64_t wanted = threads == 1 ? 1 : (2 * threads + planes.count - 1) / planes.count;
  const int64_t bands = std::clamp<int64_t>(wanted, 1, std::max<int64_t>(1, planes.height / 32));
  at::parallel_for(0, planes.count * bands, 1, [&](int64_t begin, int64_t end) {
    std::vector<T> scratch(size_t(ssim_scratch_size(planes.width)));
    for (int64_t task = begin; task < end; ++task) {
      const int64_t plane = task / bands, band = task % bands;
      work(plane, planes.height * band / bands, planes.height * (band + 1) / bands, scratch.data());
    }
  });
}

template <class T>
torch::Tensor similarity_of(const SsimArguments& in) {
  const ImagePlanes planes = planes_of(in.a);
  const int64_t pixels = planes.height * planes.width;
  std::vector<double> ssim_sums(size_t(planes.count * planes.height)), l1_sums(ssim_sums.size());
  const SsimWeights& weights = in.weights;
  const auto count = double(in.a.numel());
  const T *a = in.a.const_data_ptr<T>(), *b = in.b.const_data_ptr<T>();
  const T *mean = read_or_null<T>(in.mean_b), *square = read_or_null<T>(in.square_b);
  T *grad_a = write_or_null<T>(in.grad_a), *grad_b = write_or_null<T>(in.grad_b);
  const SsimKernels<T>& kernels = ssim_kernels().of<T>();
  for_bands<T>(planes, [&](int64_t plane, int64_t begin, int64_t end, T* scratch) {
    const auto at_plane = [&](auto* data) {
      return data == nullptr ? data : data + plane * pixels;
    };
    SsimBand<T> band;
    band.a = at_plane(a);
    band.b = at_plane(b);
    band.mean_b = at_plane(mean);
    band.square_b = at_plane(square);
    band.height = planes.height;
    band.width = planes.width;
    band.row_begin = begin;
    band.row_end = end;
    band.weight_ssim = T(weights.ssim / count);
    band.weight_l1 = T(weights.l1 / count);
    band.grad_a = at_plane(grad_a);
    band.grad_b = at_plane(grad_b);
    band.ssim_sums = ssim_sums.data() + plane * planes.height;
    band.l1_sums = weights.l1 != 0 ? l1_sums.data() + plane * planes.height : nullptr;
    band.scratch = scratch;
    kernels.band(band, ssim_window());
  });
  double ssim_sum = 0, l1_sum = 0;
  for (const double sum : ssim_sums) ssim_sum += sum;
  for (const double sum : l1_sums) l1_sum += sum;
  return torch::full({}, weights.offset + (weights.ssim * ssim_sum + weights.l1 * l1_sum) / count,
                     in.a.options().requires_grad(false));
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

torch::Tensor similarity(const SsimArguments& arguments) {
  return arguments.a.scalar_type() == torch::kFloat32 ? similarity_of<float>(arguments)
                                                      : similarity_of<double>(arguments);
}

void window_means(const torch::Tensor& image, torch::Tensor& mean, torch::Tensor& square) {
  image.scalar_type() == torch::kFloat32 ? means_of<float>(image, mean, square)
                                         : means_of<double>(image, mean, square);
}

}  // namespace cpu
}  // namespace jade::imaging
