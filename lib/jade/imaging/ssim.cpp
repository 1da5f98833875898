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

/// State of the forward pass that backward() needs. Its images have no graph.
struct Held : torch::CustomClassHolder {
  SsimBatch batch;
  std::vector<torch::Tensor> kept;
};

struct Similarity : torch::autograd::Function<Similarity> {
  /// @param images  a and b of every pair in turn, as inputs of autograd
  static variable_list forward(AutogradContext* ctx, at::TensorList images,
                               const SsimBatch& batch) {
    ctx->set_materialize_grads(false);
    SsimValues values = images[0].is_cuda()
                            ? kernel::on_cuda("SSIM", [&] { return cuda::similarity(batch); })
                            : cpu::similarity(batch);
    auto held = c10::make_intrusive<Held>();
    held->batch = batch;
    held->kept = std::move(values.kept);
    ctx->saved_data["held"] = c10::IValue::make_capsule(held);
    return {values.total, values.terms};
  }

  static variable_list backward(AutogradContext* ctx, variable_list gradients) {
    const auto held = c10::static_intrusive_pointer_cast<Held>(ctx->saved_data["held"].toCapsule());
    const SsimBatch& batch = held->batch;
    const SsimUpstream upstream{gradients[0], gradients[1]};
    variable_list result(2 * batch.pairs.size());
    if (upstream.total.defined() || upstream.terms.defined()) {
      result =
          batch.pairs[0].a.is_cuda()
              ? kernel::on_cuda(
                    "SSIM", [&] { return cuda::similarity_gradients(batch, held->kept, upstream); })
              : cpu::similarity_gradients(batch, held->kept, upstream);
    }
    result.emplace_back();  // gradient of the batch itself
    return result;
  }
};

/// The images of a pair as inputs of autograd, and the requested gradients.
SsimPair add_pair(const L1SsimPair& images, variable_list& seen) {
  check_pair(images.a, images.c.image);
  const bool tracked = torch::GradMode::is_enabled();
  SsimPair pair;
  pair.a = images.a.detach().contiguous();
  pair.b = images.c.image.detach().contiguous();
  pair.mean_b = images.c.mean;
  pair.square_b = images.c.square;
  pair.grad_a = tracked && images.a.requires_grad();
  pair.grad_b = tracked && images.c.image.requires_grad();
  seen.push_back(images.a);
  seen.push_back(images.c.image);
  return pair;
}

L1SsimSum similarity(const std::vector<L1SsimTerm>& terms, const SsimWeights& weights) {
  SsimBatch batch;
  batch.weights = weights;
  variable_list seen;
  for (const L1SsimTerm& term : terms) {
    for (const L1SsimPair& images : term.pairs) batch.pairs.push_back(add_pair(images, seen));
    batch.terms.push_back({static_cast<int64_t>(term.pairs.size()), term.weight, term.scale});
  }
  JADE_CHECK(!batch.pairs.empty(), "SSIM: expected a pair of images, found none");
  const ImagePlanes size = planes_of(batch.pairs[0].a);
  for (const SsimPair& pair : batch.pairs) {
    const ImagePlanes other = planes_of(pair.a);
    JADE_CHECK(other.height == size.height && other.width == size.width &&
                   pair.a.scalar_type() == batch.pairs[0].a.scalar_type(),
               "SSIM: expected images of one size and type, found ", shape_string(batch.pairs[0].a),
               " and ", shape_string(pair.a));
    check_same_device(batch.pairs[0].a, "first image", pair.a, "image of another pair");
  }
  const variable_list out = Similarity::apply(at::TensorList(seen), batch);
  return {out[0], out[1]};
}

torch::Tensor similarity(const torch::Tensor& a, const SsimTarget& b, const SsimWeights& weights) {
  return similarity({{{{a, b}}, 1, {}}}, weights).total;
}

SsimWeights dissimilarity_weights(double lambda) { return {lambda, -lambda, 1 - lambda}; }

/// Window means by sums of moved images: a convolution would load cuDNN, which steps without a
/// router do not need. In double, because variances are differences of these.
torch::Tensor window_mean(const torch::Tensor& image) {
  torch::Tensor mean = image.to(torch::kFloat64);
  for (const int64_t axis : {-1, -2}) {
    const int64_t size = mean.size(axis);
    std::vector<int64_t> border(axis == -1 ? 2 : 4, 0);  // of the columns, then of the rows
    border.end()[-1] = border.end()[-2] = kSsimRadius;
    const torch::Tensor padded = torch::constant_pad_nd(mean, border);
    mean = padded.narrow(axis, 0, size) * ssim_window()[0];
    for (int k = 1; k < kSsimTaps; ++k) {
      mean = mean.add(padded.narrow(axis, k, size), ssim_window()[k]);
    }
  }
  return mean.to(image.scalar_type()).contiguous();
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

torch::Tensor ssim_map(const torch::Tensor& a, const torch::Tensor& b) {
  check_pair(a, b);
  const torch::Tensor x = a.to(torch::kFloat64), y = b.to(torch::kFloat64);
  const torch::Tensor mx = window_mean(x), my = window_mean(y);
  const torch::Tensor squares = mx.square() + my.square();
  const torch::Tensor variances = window_mean(x.square() + y.square()) - squares;
  const torch::Tensor covariance = window_mean(x * y) - mx * my;
  return (2 * mx * my + kSsimC1) * (2 * covariance + kSsimC2) /
         ((squares + kSsimC1) * (variances + kSsimC2));
}

torch::Tensor l1_ssim(const torch::Tensor& a, const torch::Tensor& c, double lambda) {
  return similarity(a, {c, {}, {}}, dissimilarity_weights(lambda));
}

torch::Tensor l1_ssim(const torch::Tensor& a, const SsimTarget& c, double lambda) {
  return similarity(a, c, dissimilarity_weights(lambda));
}

L1SsimSum l1_ssim_sum(const std::vector<L1SsimTerm>& terms, double lambda) {
  return similarity(terms, dissimilarity_weights(lambda));
}

}  // namespace jade::imaging
