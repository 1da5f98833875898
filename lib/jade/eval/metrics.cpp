// SPDX-License-Identifier: Apache-2.0
#include "jade/eval/metrics.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>

#include "jade/core/check.h"
#include "jade/imaging/ssim.h"

namespace jade::eval {
namespace {

constexpr double kPerfect = 100.0;

void check_pair(const torch::Tensor& image, const torch::Tensor& truth) {
  check_shape(image, "image", {3, -1, -1});
  check_shape(truth, "truth", {3, image.size(1), image.size(2)});
}

double decibel(double mean_squared_error) {
  if (std::isnan(mean_squared_error)) return mean_squared_error;  // unknown
  return mean_squared_error > 0 ? std::min(kPerfect, -10.0 * std::log10(mean_squared_error))
                                : kPerfect;
}

/// [3,H,W], or [3,1,N] of the pixels that count.
torch::Tensor squared_error(const torch::Tensor& image, const torch::Tensor& truth,
                            const torch::Tensor& mask) {
  const torch::Tensor error = (image.detach().clamp(0, 1).to(torch::kFloat64) -
                               truth.detach().clamp(0, 1).to(torch::kFloat64))
                                  .square();
  if (!mask.defined()) return error;
  check_shape(mask, "mask", {1, image.size(1), image.size(2)});
  const torch::Tensor index = mask.to(error.device()).flatten().nonzero().flatten();
  return error.flatten(1).index_select(1, index).unsqueeze(1);
}

}  // namespace

double psnr(const torch::Tensor& image, const torch::Tensor& truth, const torch::Tensor& mask) {
  check_pair(image, truth);
  return decibel(squared_error(image, truth, mask).mean().item<double>());
}

double psnr_channel_mean(const torch::Tensor& image, const torch::Tensor& truth,
                         const torch::Tensor& mask) {
  check_pair(image, truth);
  const auto errors = squared_error(image, truth, mask).mean({1, 2}).cpu();
  double sum = 0;
  for (int64_t c = 0; c < 3; ++c) sum += decibel(errors[c].item<double>());
  return sum / 3;
}

double ssim(const torch::Tensor& image, const torch::Tensor& truth, const torch::Tensor& mask) {
  check_pair(image, truth);
  const torch::NoGradGuard no_grad;
  const auto counted = [&](const torch::Tensor& x) {
    return only_counted(x.detach().clamp(0, 1), mask).contiguous();
  };
  if (!mask.defined()) return imaging::ssim(counted(image), counted(truth)).item<double>();
  return imaging::ssim_map(counted(image), counted(truth))
      .masked_select(mask.to(image.device()))
      .mean()
      .item<double>();
}

torch::Tensor only_counted(const torch::Tensor& image, const torch::Tensor& mask) {
  return mask.defined() ? image.masked_fill(~mask.to(image.device()), 0) : image;
}

}  // namespace jade::eval
