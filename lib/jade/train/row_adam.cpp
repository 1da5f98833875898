// SPDX-License-Identifier: Apache-2.0
#include "jade/train/row_adam.h"

#include <torch/types.h>

#include "jade/core/check.h"

namespace jade::train {
namespace {

constexpr double kFirstDecay = 0.9, kSecondDecay = 0.999;

/// [V] beside the rows of `like`.
torch::Tensor per_row(const torch::Tensor& values, const torch::Tensor& like) {
  std::vector<int64_t> shape(static_cast<size_t>(like.dim()), 1);
  shape[0] = like.size(0);
  return values.view(shape);
}

void copy_checked(torch::Tensor& to, const torch::Tensor& from, const char* name) {
  check_shape(from, name, to.sizes().vec());
  to.copy_(from);
}

}  // namespace

RowAdam::RowAdam(torch::Tensor parameter, double eps)
    : parameter_(std::move(parameter)), eps_(eps) {
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
  state_.gradient.add_(parameter_.grad());
  state_.seen.index_add_(0, row, torch::ones_like(row));
}

void RowAdam::update(double lr) {
  const torch::NoGradGuard no_grad;
  const torch::Tensor moves = state_.seen.gt(0).to(torch::kFloat64);  // 0 keeps a row's bits
  const torch::Tensor share = per_row(moves, parameter_);
  const torch::Tensor& gradient = state_.gradient;
  state_.steps.add_(moves);
  state_.first.lerp_(gradient, share * (1 - kFirstDecay));
  state_.second.lerp_(gradient.square(), share * (1 - kSecondDecay));
  // A row that never moved has moments of zero, which no count must divide by zero.
  const torch::Tensor steps = per_row(state_.steps.clamp_min(1), parameter_);
  const torch::Tensor first_share = 1 - torch::pow(kFirstDecay, steps);
  const torch::Tensor second_share = 1 - torch::pow(kSecondDecay, steps);
  const torch::Tensor size = (state_.second / second_share).sqrt_().add_(eps_);
  parameter_.sub_(state_.first / size * (share * lr / first_share));
  state_.gradient.zero_();
  state_.seen.zero_();
}

void RowAdam::restore(const RowAdamState& saved) {
  const torch::NoGradGuard no_grad;
  copy_checked(state_.first, saved.first, "first moments");
  copy_checked(state_.second, saved.second, "second moments");
  copy_checked(state_.steps,
               saved.steps.dim() == 0 ? saved.steps.expand_as(state_.steps) : saved.steps,
               "step counts");
  if (!saved.gradient.defined()) {
    state_.gradient.zero_();
    state_.seen.zero_();
    return;
  }
  copy_checked(state_.gradient, saved.gradient, "gradients");
  copy_checked(state_.seen,
               saved.seen.defined() ? saved.seen : saved.gradient.flatten(1).ne(0).any(1),
               "counts of gradients");
}

}  // namespace jade::train
