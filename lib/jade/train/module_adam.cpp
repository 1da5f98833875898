// SPDX-License-Identifier: Apache-2.0
#include "jade/train/module_adam.h"

#include <torch/types.h>

#include "jade/core/check.h"

namespace jade::train {

ModuleAdam::ModuleAdam(std::vector<torch::Tensor> parameters, double lr, double eps)
    : parameters_(std::move(parameters)), lr_(lr), eps_(eps) {
  for (const torch::Tensor& parameter : parameters_) {
    first_.push_back(torch::zeros_like(parameter));
    second_.push_back(torch::zeros_like(parameter));
    // The fused step on CUDA reads counters as float32, whatever the type of the parameters.
    steps_.push_back(
        torch::zeros({}, parameter.options().dtype(torch::kFloat32).requires_grad(false)));
  }
}

void ModuleAdam::step(double lr) {
  const torch::NoGradGuard no_grad;
  std::vector<torch::Tensor> parameters, gradients, first, second, steps;
  for (size_t i = 0; i < parameters_.size(); ++i) {
    if (!parameters_[i].grad().defined()) continue;
    parameters.push_back(parameters_[i]);
    gradients.push_back(parameters_[i].grad());
    first.push_back(first_[i]);
    second.push_back(second_[i]);
    steps.push_back(steps_[i]);
  }
  JADE_CHECK(!steps.empty(), "ModuleAdam: none of ", parameters_.size(),
             " parameters has a gradient");
  at::_foreach_add_(steps, 1);
  at::_fused_adam_(parameters, gradients, first, second, {}, steps, lr, 0.9, 0.999, 0.0, eps_,
                   /*amsgrad=*/false, /*maximize=*/false);
}

void ModuleAdam::zero_grad() {
  for (torch::Tensor& parameter : parameters_) parameter.mutable_grad() = torch::Tensor();
}

}  // namespace jade::train
