// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/edi.h"

#include <cmath>
#include <torch/types.h>
#include <vector>

#include "jade/core/check.h"

namespace jade::imaging {

using events::EdiIndex;
using geometry::QuadratureRule;

namespace {

/// Between the maps of `values` [N,H,W] at the places [M] of a ruler whose n-th mark is n; the
/// first and the last map go on beyond it. Differentiable in both.
torch::Tensor between(const torch::Tensor& values, const torch::Tensor& places) {
  const auto last = static_cast<double>(values.size(0) - 1);
  const auto inside = places.clamp(0, last);
  const auto lower = inside.detach().floor().clamp(0, last - 1);
  const auto share = (inside - lower).to(values.scalar_type()).view({-1, 1, 1});
  const auto index = lower.to(torch::kInt64);
  return torch::lerp(values.index_select(0, index), values.index_select(0, index + 1), share);
}

}  // namespace

EdiKernel edi_kernel(const torch::Tensor& windows, QuadratureRule rule, EdiIndex index) {
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
  auto log_gain = log_ratio - log_blur;
  if (index == EdiIndex::kDiet) {
    check_shape(windows, "EDI windows of the DiET-GS release", {8, -1, -1});
    log_gain =
        torch::cat({log_gain.narrow(0, 0, 5), log_gain.narrow(0, 6, 3), log_gain.narrow(0, 8, 1)});
  }
  return {log_gain, log_gain.exp(), log_blur.exp()};
}

torch::Tensor edi_gain(const torch::Tensor& log_gain, const torch::Tensor& u) {
  check_shape(log_gain, "EDI log gain", {-1, -1, -1});
  check_shape(u, "moments", {-1});
  return between(log_gain, u * static_cast<double>(log_gain.size(0) - 1)).exp();
}

EdiCounts edi_counts(const events::WindowCounts& windows, int64_t margin, QuadratureRule rule) {
  check_shape(windows.positive, "windows of positive events", {-1, -1, -1});
  check_shape(windows.negative, "windows of negative events", windows.positive.sizes().vec());
  const int64_t spans = windows.positive.size(0), mid = spans / 2, parts = spans - 2 * margin;
  JADE_CHECK(margin >= 0 && parts >= 2 && parts % 2 == 0,
             "expected an even number of EDI windows and a margin twice, found ", spans,
             " windows and a margin of ", margin);
  const auto from_mid = [mid](const torch::Tensor& counts) {
    const auto before = counts.narrow(0, 0, mid).flip(0).cumsum(0).flip(0).neg();
    const auto after = counts.narrow(0, mid, mid).cumsum(0);
    return torch::cat({before, torch::zeros_like(counts.narrow(0, 0, 1)), after});
  };
  const auto weights =
      torch::tensor(geometry::quadrature(rule, parts + 1).weights, torch::kFloat64);
  return {from_mid(windows.positive), from_mid(windows.negative),
          weights.to(windows.positive.options())};
}

torch::Tensor edi_log_gain(const EdiCounts& counts, const EdiSensor& sensor,
                           const torch::Tensor& u) {
  check_shape(counts.positive, "cumulative counts", {-1, -1, -1});
  check_shape(counts.negative, "cumulative counts", counts.positive.sizes().vec());
  check_shape(sensor.log_gain, "log gain of the pixels",
              {counts.positive.size(1), counts.positive.size(2)});
  check_shape(u, "moments", {-1});
  const int64_t samples = counts.weights.size(0);
  const auto margin = static_cast<double>((counts.positive.size(0) - samples) / 2);
  const auto parts = static_cast<double>(samples - 1);
  const auto contrast = sensor.log_gain.exp() * (sensor.threshold_positive * counts.positive -
                                                 sensor.threshold_negative * counts.negative);
  const auto start = sensor.shift * parts + margin;
  const auto moments = torch::arange(samples, u.options());
  const auto weights = counts.weights.log().view({-1, 1, 1});
  const auto log_blur = (between(contrast, moments + start) + weights).logsumexp(0);
  return between(contrast, u * parts + start) - log_blur;
}

torch::Tensor edi_mid(const torch::Tensor& blurry, const EdiKernel& kernel) {
  check_shape(blurry, "blurry", {-1, kernel.blur.size(0), kernel.blur.size(1)});
  check_same_device(blurry, "blurry", kernel.blur, "EDI kernel");
  return blurry * kernel.gain.narrow(0, kernel.gain.size(0) / 2, 1);
}

}  // namespace jade::imaging
