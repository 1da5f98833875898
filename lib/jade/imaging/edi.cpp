// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/edi.h"

#include <cmath>
#include <torch/types.h>
#include <vector>

#include "jade/core/check.h"

namespace jade::imaging {

using geometry::QuadratureRule;

namespace {

/// Interpolates the maps `values` [N,H,W] at fractional indices [M]; extrapolates from the first
/// and last two maps. Differentiable in both.
torch::Tensor between(const torch::Tensor& values, const torch::Tensor& places) {
  const auto last = static_cast<double>(values.size(0) - 1);
  const auto inside = places.clamp(0, last);
  const auto lower = inside.detach().floor().clamp(0, last - 1);
  const auto share = (inside - lower).to(values.scalar_type()).view({-1, 1, 1});
  const auto index = lower.to(torch::kInt64);
  return torch::lerp(values.index_select(0, index), values.index_select(0, index + 1), share);
}

}  // namespace

EdiKernel edi_kernel(const torch::Tensor& windows, QuadratureRule rule) {
  check_shape(windows, "EDI windows", {-1, -1, -1});
  const int64_t parts = windows.size(0), mid = parts / 2;
  JADE_CHECK(parts >= 2 && parts % 2 == 0, "expected an even number of EDI windows, found ", parts);
  const auto before = windows.narrow(0, 0, mid).flip(0).cumsum(0).flip(0).neg();
  const auto after = windows.narrow(0, mid, mid).cumsum(0);
  auto log_ratio = torch::cat({before, torch::zeros_like(windows.narrow(0, 0, 1)), after});
  torch::Tensor log_blur;
  if (rule == QuadratureRule::kTrapezoid) {
    const auto weights =
        torch::tensor(geometry::quadrature(rule, parts + 1).weights, torch::kFloat64).log();
    log_blur = (log_ratio + weights.to(windows.options()).view({-1, 1, 1})).logsumexp(0);
  } else {
    log_blur = log_ratio.logsumexp(0) - std::log(double(parts + 1));
  }
  const auto log_gain = log_ratio - log_blur;
  return {log_gain, log_gain.exp(), log_blur.exp()};
}

torch::Tensor edi_gain(const torch::Tensor& log_gain, const torch::Tensor& u) {
  check_shape(log_gain, "EDI log gain", {-1, -1, -1});
  check_shape(u, "moments", {-1});
  return between(log_gain, u * static_cast<double>(log_gain.size(0) - 1)).exp();
}

torch::Tensor edi_mid(const torch::Tensor& blurry, const EdiKernel& kernel) {
  check_shape(blurry, "blurry", {-1, kernel.blur.size(0), kernel.blur.size(1)});
  check_same_device(blurry, "blurry", kernel.blur, "EDI kernel");
  return blurry * kernel.gain.narrow(0, kernel.gain.size(0) / 2, 1);
}

}  // namespace jade::imaging
