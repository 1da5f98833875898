// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/ssim.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <torch/csrc/autograd/custom_function.h>
#include <vector>

#include "jade/core/check.h"
#include "jade/imaging/ssim_kernels.h"

namespace jade::imaging {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

/// value = offset + ssim · mean SSIM + l1 · mean |a − b|.
struct Weights {
  double offset = 0, ssim = 0, l1 = 0;
};

struct Planes {
  int64_t count = 0, height = 0, width = 0;
};

Planes planes_of(const torch::Tensor& image) {
  const int64_t height = image.size(-2), width = image.size(-1);
  return {image.numel() / (height * width), height, width};
}

void check_pair(const torch::Tensor& a, const torch::Tensor& b) {
  JADE_CHECK(a.defined() && (a.dim() == 3 || a.dim() == 4) && a.numel() > 0,
             "SSIM: expected images [C,H,W] or [N,C,H,W], found ", shape_string(a));
  JADE_CHECK(b.defined() && a.sizes() == b.sizes(), "SSIM: expected images of one shape, found ",
             shape_string(a), " and ", shape_string(b));
  check_same_device(a, "first image", b, "second image");
  JADE_CHECK(
      a.scalar_type() == b.scalar_type() && (a.scalar_type() == torch::kFloat32 ||
                                             (a.scalar_type() == torch::kFloat64 && a.is_cpu())),
      "SSIM: expected two float images (or double, on the CPU), found ", a.scalar_type(), " and ",
      b.scalar_type());
}

/// Runs work(plane, first row, last row, scratch) over bands of rows. Results are kept a row, so
/// that the division, which depends on the threads, does not show.
template <class T, class Work>
void for_bands(const Planes& planes, const Work& work) {
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
T* data_or_null(const torch::Tensor& tensor) {
  return tensor.defined() ? tensor.template mutable_data_ptr<T>() : nullptr;
}

template <class T>
torch::Tensor similarity_cpu(const torch::Tensor& a, const SsimTarget& b, const Weights& weights,
                             torch::Tensor& grad_a, torch::Tensor& grad_b) {
  const Planes planes = planes_of(a);
  const int64_t pixels = planes.height * planes.width;
  std::vector<double> ssim_sums(size_t(planes.count * planes.height)), l1_sums(ssim_sums.size());
  const T *pa = a.const_data_ptr<T>(), *pb = b.image.const_data_ptr<T>();
  const T* mean = b.mean.defined() ? b.mean.const_data_ptr<T>() : nullptr;
  const T* square = b.square.defined() ? b.square.const_data_ptr<T>() : nullptr;
  T *ga = data_or_null<T>(grad_a), *gb = data_or_null<T>(grad_b);
  for_bands<T>(planes, [&](int64_t plane, int64_t begin, int64_t end, T* scratch) {
    const auto at_plane = [&](auto* data) {
      return data == nullptr ? data : data + plane * pixels;
    };
    SsimBand<T> band;
    band.a = at_plane(pa);
    band.b = at_plane(pb);
    band.mean_b = at_plane(mean);
    band.square_b = at_plane(square);
    band.height = planes.height;
    band.width = planes.width;
    band.row_begin = begin;
    band.row_end = end;
    band.weight_ssim = T(weights.ssim / double(a.numel()));
    band.weight_l1 = T(weights.l1 / double(a.numel()));
    band.grad_a = at_plane(ga);
    band.grad_b = at_plane(gb);
    band.ssim_sums = ssim_sums.data() + plane * planes.height;
    band.l1_sums = weights.l1 != 0 ? l1_sums.data() + plane * planes.height : nullptr;
    band.scratch = scratch;
    ssim_band(band, ssim_window());
  });
  double ssim_sum = 0, l1_sum = 0;
  for (const double sum : ssim_sums) ssim_sum += sum;
  for (const double sum : l1_sums) l1_sum += sum;
  return torch::full(
      {}, weights.offset + (weights.ssim * ssim_sum + weights.l1 * l1_sum) / double(a.numel()),
      a.options().requires_grad(false));
}

torch::Tensor similarity_cuda(const torch::Tensor& a, const SsimTarget& b, const Weights& weights,
                              torch::Tensor& grad_a, torch::Tensor& grad_b) {
  const Planes planes = planes_of(a);
  const auto options = a.options().requires_grad(false);
  auto value = torch::empty({}, options);
  auto partial = torch::empty({ssim_cuda_blocks(planes.count, planes.height, planes.width), 2},
                              options.dtype(torch::kFloat64));
  torch::Tensor maps;
  if (grad_a.defined() || grad_b.defined())
    maps = torch::empty({grad_b.defined() ? 4 : 3, a.numel()}, options);
  SsimCuda in;
  in.a = a.const_data_ptr<float>();
  in.b = b.image.const_data_ptr<float>();
  in.mean_b = b.mean.defined() ? b.mean.const_data_ptr<float>() : nullptr;
  in.square_b = b.square.defined() ? b.square.const_data_ptr<float>() : nullptr;
  in.planes = planes.count;
  in.height = planes.height;
  in.width = planes.width;
  in.weight_ssim = float(weights.ssim / double(a.numel()));
  in.weight_l1 = float(weights.l1 / double(a.numel()));
  in.offset = weights.offset;
  in.maps = data_or_null<float>(maps);
  in.grad_a = data_or_null<float>(grad_a);
  in.grad_b = data_or_null<float>(grad_b);
  in.partial = partial.mutable_data_ptr<double>();
  in.value = value.mutable_data_ptr<float>();
  ssim_cuda(in, ssim_window(), a.device().index());
  return value;
}

struct Similarity : torch::autograd::Function<Similarity> {
  static torch::Tensor forward(AutogradContext* ctx, const torch::Tensor& a, const torch::Tensor& b,
                               const SsimTarget& target, const Weights& weights, bool grad_to_a,
                               bool grad_to_b) {
    const auto first = a.contiguous();
    const SsimTarget second{b.contiguous(), target.mean, target.square};
    torch::Tensor grad_a, grad_b;
    if (grad_to_a) grad_a = torch::empty_like(first);
    if (grad_to_b) grad_b = torch::empty_like(second.image);
    const auto value = a.is_cuda() ? similarity_cuda(first, second, weights, grad_a, grad_b)
                       : a.scalar_type() == torch::kFloat32
                           ? similarity_cpu<float>(first, second, weights, grad_a, grad_b)
                           : similarity_cpu<double>(first, second, weights, grad_a, grad_b);
    ctx->save_for_backward({grad_a, grad_b});
    return value;
  }

  static variable_list backward(AutogradContext* ctx, variable_list grad_outputs) {
    const auto saved = ctx->get_saved_variables();
    const auto scaled = [&](const torch::Tensor& grad) {
      return grad.defined() ? grad * grad_outputs[0] : torch::Tensor();
    };
    return {scaled(saved[0]), scaled(saved[1]), {}, {}, {}, {}};
  }
};

torch::Tensor similarity(const torch::Tensor& a, const SsimTarget& b, const Weights& weights) {
  check_pair(a, b.image);
  const bool tracked = torch::GradMode::is_enabled();
  return Similarity::apply(a, b.image, b, weights, tracked && a.requires_grad(),
                           tracked && b.image.requires_grad());
}

Weights dissimilarity_weights(double lambda) { return {lambda, -lambda, 1 - lambda}; }

template <class T>
void moments_cpu(const torch::Tensor& image, torch::Tensor& mean, torch::Tensor& square) {
  const Planes planes = planes_of(image);
  const int64_t pixels = planes.height * planes.width;
  const T* data = image.const_data_ptr<T>();
  T *mean_data = mean.mutable_data_ptr<T>(), *square_data = square.mutable_data_ptr<T>();
  for_bands<T>(planes, [&](int64_t plane, int64_t begin, int64_t end, T* scratch) {
    SsimBand<T> band;
    band.b = data + plane * pixels;
    band.height = planes.height;
    band.width = planes.width;
    band.row_begin = begin;
    band.row_end = end;
    band.scratch = scratch;
    ssim_moments(band, ssim_window(), mean_data + plane * pixels, square_data + plane * pixels);
  });
}

/// Window means by two convolutions: done once per target, where speed does not matter. In double,
/// because cuDNN may round float products to TF32, and variances are differences of these.
torch::Tensor window_mean(const torch::Tensor& image) {
  const Planes planes = planes_of(image);
  const auto wide = image.options().dtype(torch::kFloat64);
  const std::vector<double> window(ssim_window(), ssim_window() + kSsimTaps);
  const auto taps = torch::tensor(window, torch::kFloat64).to(wide);
  const auto stacked = image.to(wide).reshape({planes.count, 1, planes.height, planes.width});
  const auto rows = torch::conv2d(stacked, taps.view({1, 1, 1, kSsimTaps}), {}, 1,
                                  torch::IntArrayRef{0, kSsimRadius});
  return torch::conv2d(rows, taps.view({1, 1, kSsimTaps, 1}), {}, 1,
                       torch::IntArrayRef{kSsimRadius, 0})
      .reshape(image.sizes())
      .to(image.scalar_type())
      .contiguous();
}

}  // namespace

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

SsimTarget ssim_target(const torch::Tensor& image) {
  check_pair(image, image);
  const torch::NoGradGuard no_grad;
  const auto fixed = image.detach().contiguous();
  if (!fixed.is_cpu())
    return {fixed, window_mean(fixed),
            window_mean(fixed.to(torch::kFloat64).square()).to(fixed.scalar_type())};
  SsimTarget out{fixed, torch::empty_like(fixed), torch::empty_like(fixed)};
  fixed.scalar_type() == torch::kFloat32 ? moments_cpu<float>(fixed, out.mean, out.square)
                                         : moments_cpu<double>(fixed, out.mean, out.square);
  return out;
}

torch::Tensor ssim(const torch::Tensor& a, const torch::Tensor& b) {
  return similarity(a, {b, {}, {}}, {0, 1, 0});
}

torch::Tensor ssim(const torch::Tensor& a, const SsimTarget& b) {
  return similarity(a, b, {0, 1, 0});
}

torch::Tensor l1_ssim(const torch::Tensor& a, const torch::Tensor& c, double lambda) {
  return similarity(a, {c, {}, {}}, dissimilarity_weights(lambda));
}

torch::Tensor l1_ssim(const torch::Tensor& a, const SsimTarget& c, double lambda) {
  return similarity(a, c, dissimilarity_weights(lambda));
}

}  // namespace jade::imaging
