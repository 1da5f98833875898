// SPDX-License-Identifier: Apache-2.0
#include "jade/train/row_adam.h"

#include <torch/types.h>

#include "jade/core/check.h"
#include "jade/kernel/on_cuda.h"
#include "jade/train/pose_update.h"

namespace jade::train {
RowAdam::RowAdam(torch::Tensor parameter, double eps)
    : parameter_(std::move(parameter)), eps_(eps) {
  JADE_CHECK(parameter_.scalar_type() == torch::kFloat64 && parameter_.is_contiguous(),
             "RowAdam: expected a parameter of float64, row after row");
  const auto options = parameter_.options().requires_grad(false);
  state_.first = torch::zeros(parameter_.sizes(), options);
  state_.second = torch::zeros(parameter_.sizes(), options);
  state_.steps = torch::zeros({parameter_.size(0)}, options.dtype(torch::kFloat64));
  state_.gradient = torch::zeros(parameter_.sizes(), options);
  state_.seen = torch::zeros({parameter_.size(0)}, options.dtype(torch::kInt64));
}

void RowAdam::accumulate(const torch::Tensor& row) {
  const torch::NoGradGuard no_grad;
  JADE_CHECK(parameter_.grad().defined(), "RowAdam: the parameter has no gradient");
  check_shape(row, "row", {1});
  check_dtype(row, "row", torch::kInt64);
  check_same_device(row, "row", parameter_, "parameter");
  const torch::Tensor of = parameter_.grad().contiguous();
  RowGradient step;
  step.of = of.const_data_ptr<double>();
  step.gradient = state_.gradient.mutable_data_ptr<double>();
  step.seen = state_.seen.mutable_data_ptr<int64_t>();
  step.row = row.const_data_ptr<int64_t>();
  step.size = of.numel();
  if (!parameter_.is_cuda()) return cpu::accumulate(step);
  kernel::on_cuda("the gradient of the poses", [&] { cuda::accumulate(step); });
}

void RowAdam::update(double lr) {
  const torch::NoGradGuard no_grad;
  RowStep step;
  step.value = parameter_.mutable_data_ptr<double>();
  step.first = state_.first.mutable_data_ptr<double>();
  step.second = state_.second.mutable_data_ptr<double>();
  step.gradient = state_.gradient.mutable_data_ptr<double>();
  step.steps = state_.steps.mutable_data_ptr<double>();
  step.seen = state_.seen.mutable_data_ptr<int64_t>();
  step.rows = parameter_.size(0);
  step.row = step.rows == 0 ? 0 : parameter_.numel() / step.rows;
  step.lr = lr;
  step.eps = eps_;
  if (!parameter_.is_cuda()) return cpu::update_rows(step);
  kernel::on_cuda("the Adam step of the poses", [&] { cuda::update_rows(step); });
}

}  // namespace jade::train
