// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/optimizer.h"

#include <algorithm>
#include <cmath>

#include "jade/core/check.h"
#include "jade/gaussians/adam_math.h"
#include "jade/kernel/on_cuda.h"

namespace jade::gaussians {
namespace {

constexpr int kMeans = 0;
constexpr int kSh = 4;

/// Sets the step sizes of parameter `index`; the means' is multiplied by the schedule.
void set_rates(const OptimOptions& options, double extent, int index, AdamGroup* group) {
  const double rates[kParameterCount] = {extent, options.rotation_lr, options.scale_lr,
                                         options.opacity_lr, options.sh_dc_lr};
  group->head_lr = rates[index];
  group->tail_lr = index == kSh ? options.sh_rest_lr : rates[index];
  group->scheduled = index == kMeans;
}

/// Schedule of the means; a step size of 0 has no logarithm.
AdamSchedule schedule_of(const OptimOptions& options) {
  return {std::log(std::max(options.position_lr_start, 1e-300)),
          std::log(std::max(options.position_lr_start / kPositionLrFall, 1e-300)),
          static_cast<double>(options.position_lr_max_steps)};
}

torch::Tensor gathered(const torch::Tensor& values, const torch::Tensor& rows) {
  const torch::Tensor fresh = rows < 0;
  std::vector<int64_t> mask_shape(static_cast<size_t>(values.dim()), 1);
  mask_shape[0] = rows.size(0);
  if (values.size(0) == 0) {
    std::vector<int64_t> shape = values.sizes().vec();
    shape[0] = rows.size(0);
    return values.new_zeros(shape);
  }
  return values.index_select(0, rows.clamp_min(0)).masked_fill_(fresh.view(mask_shape), 0);
}

}  // namespace

double position_lr(const OptimOptions& options, int64_t step) {
  if (options.position_lr_start <= 0) return 0;
  return scheduled(schedule_of(options), static_cast<double>(step));
}

GaussianAdam::GaussianAdam(const GaussianModel& model, const OptimOptions& options, bool monochrome)
    : options_(options), extent_(model.extent()), monochrome_(monochrome) {
  const auto zeros = [](const torch::Tensor& value) { return torch::zeros_like(value.detach()); };
  first_ = map_parameters(model.parameters(), zeros);
  second_ = map_parameters(model.parameters(), zeros);
  step_count_ = torch::zeros({1}, model.parameters().means.options().dtype(torch::kInt64));
}

void GaussianAdam::step(GaussianModel& model) {
  const torch::NoGradGuard no_grad;
  JADE_CHECK(model.size() == first_.size(), "GaussianAdam: ", first_.size(), " rows for ",
             model.size(), " Gaussians");
  AdamStep step;
  step.schedule = schedule_of(options_);
  step.step = step_count_.mutable_data_ptr<int64_t>();
  std::vector<torch::Tensor> kept;  // must live until the kernels are queued
  for (int i = 0; i < kParameterCount; ++i) {
    const torch::Tensor& value = parameter(model.parameters(), i);
    if (!value.grad().defined()) continue;
    kept.push_back(value.grad().contiguous());
    AdamGroup& group = step.groups[step.group_count++];
    group.value = value.mutable_data_ptr<float>();
    group.first = parameter(first_, i).mutable_data_ptr<float>();
    group.second = parameter(second_, i).mutable_data_ptr<float>();
    group.gradient = kept.back().const_data_ptr<float>();
    group.count = value.numel();
    group.row = value.dim() == 1 ? 1 : value.numel() / std::max<int64_t>(1, value.size(0));
    group.row = std::max<int64_t>(1, group.row);
    group.head = i == kSh ? 3 : group.row;
    group.tied = monochrome_ && i == kSh;
    set_rates(options_, extent_, i, &group);
  }
  if (model.device().is_cuda()) {
    kept.push_back(torch::empty({3}, step_count_.options().dtype(torch::kFloat64)));
    step.rates = kept.back().mutable_data_ptr<double>();
    kernel::on_cuda("the Adam step of the Gaussians", [&] { cuda::adam_step(step); });
  } else {
    cpu::adam_step(step);
  }
}

void GaussianAdam::gather_rows(const torch::Tensor& rows) {
  const torch::NoGradGuard no_grad;
  check_dtype(rows, "rows", torch::kInt64);
  // One tensor at a time, so that its old rows are freed before the next one is copied.
  for (splat::Gaussians* moments : {&first_, &second_}) {
    for (int i = 0; i < kParameterCount; ++i) {
      parameter(*moments, i) = gathered(parameter(*moments, i), rows);
    }
  }
}

void GaussianAdam::reset_parameter(int index) {
  parameter(first_, index).zero_();
  parameter(second_, index).zero_();
}

void GaussianAdam::reset_rows(const torch::Tensor& rows) {
  for (int i = 0; i < kParameterCount; ++i) {
    parameter(first_, i).index_fill_(0, rows, 0);
    parameter(second_, i).index_fill_(0, rows, 0);
  }
}

}  // namespace jade::gaussians
