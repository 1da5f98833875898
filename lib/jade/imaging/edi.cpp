// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/edi.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <cmath>
#include <torch/types.h>

#include "jade/core/check.h"

namespace jade::imaging {
namespace {

using geometry::QuadratureRule;

// Bytes of the windows of one part: on the CPU a part's maps should fit a core's cache.
constexpr int64_t kCpuPartBytes = 1 << 19, kGpuPartBytes = 1 << 26;

/// Interpolates the maps `values` [N,H,W] at fractional indices [M].
torch::Tensor between(const torch::Tensor& values, const torch::Tensor& places) {
  const auto last = static_cast<double>(values.size(0) - 1);
  const auto inside = places.clamp(0, last);
  const auto lower = inside.floor().clamp(0, last - 1);
  const auto share = (inside - lower).to(values.scalar_type()).view({-1, 1, 1});
  const auto index = lower.to(torch::kInt64);
  return torch::lerp(values.index_select(0, index), values.index_select(0, index + 1), share);
}

/// ln(I_s / B) of the S moments, [S,H,W].
torch::Tensor log_gain(const torch::Tensor& windows, QuadratureRule rule) {
  const int64_t parts = windows.size(0), mid = parts / 2;
  const auto before = windows.narrow(0, 0, mid).flip(0).cumsum(0).flip(0).neg();
  const auto after = windows.narrow(0, mid, mid).cumsum(0);
  const auto log_ratio = torch::cat({before, torch::zeros_like(windows.narrow(0, 0, 1)), after});
  if (rule == QuadratureRule::kTrapezoid) {
    const auto weights =
        torch::tensor(geometry::quadrature(rule, parts + 1).weights, torch::kFloat64).log();
    return log_ratio - (log_ratio + weights.to(windows.options()).view({-1, 1, 1})).logsumexp(0);
  }
  return log_ratio - (log_ratio.logsumexp(0) - std::log(double(parts + 1)));
}

}  // namespace

torch::Tensor edi_gain(const torch::Tensor& windows, QuadratureRule rule, const torch::Tensor& u,
                       double contrast) {
  check_shape(windows, "EDI windows", {-1, -1, -1});
  check_shape(u, "moments", {-1});
  const int64_t spans = windows.size(0), moments = u.size(0);
  JADE_CHECK(spans >= 2 && spans % 2 == 0, "expected an even number of EDI windows, found ", spans);
  const torch::Tensor places = u * static_cast<double>(spans);
  const torch::Tensor rows = windows.flatten(1).unsqueeze(1);
  torch::Tensor gain = torch::empty({moments, 1, rows.size(2)}, windows.options());
  const int64_t bytes = windows.is_cuda() ? kGpuPartBytes : kCpuPartBytes;
  const auto pixels =
      std::max<int64_t>(1, bytes / (spans * static_cast<int64_t>(windows.element_size())));
  const auto compute = [&](int64_t first_part, int64_t last_part) {
    for (int64_t part = first_part; part < last_part; ++part) {
      const int64_t first = part * pixels, count = std::min(pixels, rows.size(2) - first);
      const torch::Tensor some = rows.narrow(2, first, count);
      const torch::Tensor log = log_gain(contrast == 1 ? some : some * contrast, rule);
      gain.narrow(2, first, count).copy_(between(log, places).exp());
    }
  };
  const int64_t parts = (rows.size(2) + pixels - 1) / pixels;
  if (windows.is_cuda()) {
    compute(0, parts);
  } else {
    at::parallel_for(0, parts, 1, compute);
  }
  return gain.view({moments, windows.size(1), windows.size(2)});
}

}  // namespace jade::imaging
