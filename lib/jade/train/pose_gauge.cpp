// SPDX-License-Identifier: Apache-2.0
#include "jade/train/pose_gauge.h"

#include <algorithm>
#include <torch/types.h>

#include "jade/core/check.h"
#include "jade/kernel/on_cuda.h"
#include "jade/train/pose_update.h"

namespace jade::train {
namespace {

/// Least norm of a direction after orthogonalisation; a smaller norm is rounding.
constexpr double kNewWay = 1e-9;

/// The seven directions as twists, [7,V,K,6].
torch::Tensor world_motions(const torch::Tensor& control) {
  const torch::Tensor back = control.narrow(-1, 0, 3).narrow(-2, 0, 3).transpose(-1, -2);
  torch::Tensor centre = control.narrow(-2, 0, 3).select(-1, 3);
  centre = centre - centre.mean(at::IntArrayRef({0, 1}), /*keepdim=*/true);
  const auto to_camera = [&](const torch::Tensor& v) {
    return back.matmul(v.unsqueeze(-1)).squeeze(-1);
  };
  const torch::Tensor axes = torch::eye(3, control.options());
  const torch::Tensor still = torch::zeros_like(centre);
  std::vector<torch::Tensor> ways;
  for (int64_t i = 0; i < 3; ++i) {
    ways.push_back(torch::cat({to_camera(axes[i].expand_as(centre)), still}, -1));
  }
  for (int64_t i = 0; i < 3; ++i) {
    const torch::Tensor axis = axes[i].expand_as(centre);
    ways.push_back(torch::cat({to_camera(torch::linalg_cross(axis, centre)), to_camera(axis)}, -1));
  }
  ways.push_back(torch::cat({to_camera(centre), still}, -1));
  return torch::stack(ways);
}

}  // namespace

PoseGauge pose_gauge(const torch::Tensor& control, double depth) {
  check_shape(control, "control poses", {-1, -1, 4, 4});
  JADE_CHECK(depth > 0, "expected a depth above 0, found ", depth);
  const torch::Tensor unit = torch::cat(
      {torch::full({3}, 1 / depth, control.options()), torch::ones({3}, control.options())});
  // Gram-Schmidt, applied twice, is accurate enough for seven directions and independent of the
  // number of threads.
  std::vector<torch::Tensor> basis;
  for (const torch::Tensor& way : (world_motions(control) * unit).unbind(0)) {
    torch::Tensor rest = way;
    for (int round = 0; round < 2; ++round) {
      for (const torch::Tensor& earlier : basis) rest = rest - (earlier * rest).sum() * earlier;
    }
    const double length = rest.norm().item<double>();
    if (length > kNewWay * std::max(1.0, way.norm().item<double>())) {
      basis.push_back(rest / length);
    }
  }
  const torch::Tensor all = torch::stack(basis);
  return {(all * unit).contiguous(), (all / unit).contiguous()};
}

void remove_gauge(const PoseGauge& gauge, const torch::Tensor& twists) {
  const torch::NoGradGuard no_grad;
  check_shape(twists, "twists", gauge.read.sizes().slice(1).vec());
  check_same_device(twists, "twists", gauge.read, "gauge");
  JADE_CHECK(twists.is_contiguous(), "expected contiguous twists");
  const torch::Tensor along = torch::empty({gauge.read.size(0)}, gauge.read.options());
  GaugeStep step;
  step.read = gauge.read.const_data_ptr<double>();
  step.write = gauge.write.const_data_ptr<double>();
  step.twists = twists.mutable_data_ptr<double>();
  step.along = along.mutable_data_ptr<double>();
  step.ways = gauge.read.size(0);
  step.size = twists.numel();
  if (!twists.is_cuda()) return cpu::remove_gauge(step);
  kernel::on_cuda("holding the gauge of the poses", [&] { cuda::remove_gauge(step); });
}

}  // namespace jade::train
