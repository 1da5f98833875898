// SPDX-License-Identifier: Apache-2.0
#include "jade/train/module_adam.h"

#include <map>
#include <torch/types.h>

#include "jade/core/check.h"

namespace jade::train {

ModuleAdam::ModuleAdam(std::vector<torch::Tensor> parameters, double lr, double eps)
    : ModuleAdam(parameters, std::vector<double>(parameters.size(), lr), eps) {}

ModuleAdam::ModuleAdam(std::vector<torch::Tensor> parameters, std::vector<double> lrs, double eps)
    : parameters_(std::move(parameters)), lrs_(std::move(lrs)), eps_(eps) {
  JADE_CHECK(lrs_.size() == parameters_.size(), "ModuleAdam: expected ", parameters_.size(),
             " step sizes, found ", lrs_.size());
  for (const torch::Tensor& parameter : parameters_) {
    first_.push_back(torch::zeros_like(parameter));
    second_.push_back(torch::zeros_like(parameter));
    // The fused step on CUDA reads counters as float32, whatever the type of the parameters.
    steps_.push_back(
        torch::zeros({}, parameter.options().dtype(torch::kFloat32).requires_grad(false)));
  }
}

void ModuleAdam::step(const std::vector<double>& lrs) {
  struct Group {
    std::vector<torch::Tensor> parameters, gradients, first, second, steps;
  };
  const torch::NoGradGuard no_grad;
  std::map<double, Group> groups;
  for (size_t i = 0; i < parameters_.size(); ++i) {
    if (!parameters_[i].grad().defined()) continue;
    Group& group = groups[lrs[i]];
    group.parameters.push_back(parameters_[i]);
    group.gradients.push_back(parameters_[i].grad());
    group.first.push_back(first_[i]);
    group.second.push_back(second_[i]);
    group.steps.push_back(steps_[i]);
  }
  JADE_CHECK(!groups.empty(), "ModuleAdam: none of ", parameters_.size(),
             " parameters has a gradient");
  for (auto& [lr, group] : groups) {
    at::_foreach_add_(group.steps, 1);
    at::_fused_adam_(group.parameters, group.gradients, group.first, group.second, {}, group.steps,
                     lr, 0.9, 0.999, 0.0, eps_, /*amsgrad=*/false, /*maximize=*/false);
  }
}

void ModuleAdam::zero_grad() {
  for (torch::Tensor& parameter : parameters_) parameter.mutable_grad() = torch::Tensor();
}

}  // namespace jade::train
