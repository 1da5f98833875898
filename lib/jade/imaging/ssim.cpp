// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/ssim.h"

#include <torch/csrc/autograd/custom_function.h>
#include <vector>

#include "jade/core/check.h"
#include "jade/imaging/ssim_kernels.h"
#include "jade/imaging/ssim_math.h"
#include "jade/kernel/on_cuda.h"

namespace jade::imaging {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

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

struct Similarity : torch::autograd::Function<Similarity> {
  static torch::Tensor forward(AutogradContext* ctx, const torch::Tensor& a, const torch::Tensor& b,
                               const SsimTarget& target, const SsimWeights& weights, bool grad_to_a,
                               bool grad_to_b) {
    SsimArguments in;
    in.a = a.contiguous();
    in.b = b.contiguous();
    in.mean_b = target.mean;
    in.square_b = target.square;
    in.weights = weights;
    if (grad_to_a) in.grad_a = torch::empty_like(in.a);
    if (grad_to_b) in.grad_b = torch::empty_like(in.b);
    const auto value = a.is_cuda() ? kernel::on_cuda("SSIM", [&] { return cuda::similarity(in); })
                                   : cpu::similarity(in);
    ctx->save_for_backward({in.grad_a, in.grad_b});
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

torch::Tensor similarity(const torch::Tensor& a, const SsimTarget& b, const SsimWeights& weights) {
  check_pair(a, b.image);
  const bool tracked = torch::GradMode::is_enabled();
  return Similarity::apply(a, b.image, b, weights, tracked && a.requires_grad(),
                           tracked && b.image.requires_grad());
}

SsimWeights dissimilarity_weights(double lambda) { return {lambda, -lambda, 1 - lambda}; }

/// Window means by two convolutions: done once per target, where speed does not matter. In double,
/// because cuDNN may round float products to TF32, and variances are differences of these.
torch::Tensor window_mean(const torch::Tensor& image) {
  const ImagePlanes planes = planes_of(image);
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

SsimTarget ssim_target(const torch::Tensor& image) {
  check_pair(image, image);
  const torch::NoGradGuard no_grad;
  const auto fixed = image.detach().contiguous();
  if (!fixed.is_cpu())
    return {fixed, window_mean(fixed),
            window_mean(fixed.to(torch::kFloat64).square()).to(fixed.scalar_type())};
  SsimTarget out{fixed, torch::empty_like(fixed), torch::empty_like(fixed)};
  cpu::window_means(fixed, out.mean, out.square);
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
