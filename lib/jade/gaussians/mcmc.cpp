// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/mcmc.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "jade/core/random.h"
#include "jade/gaussians/noise.h"
#include "jade/kernel/on_cuda.h"

namespace jade::gaussians {
namespace {

constexpr int64_t kMostCopies = 51;

/// Rotates [M,3] by unit quaternions [M,4] (wxyz): x + 2 w (u × x) + 2 u × (u × x).
torch::Tensor rotate(const torch::Tensor& quaternions, const torch::Tensor& x) {
  const torch::Tensor unit = quaternions / quaternions.norm(2, 1, true).clamp_min(1e-12);
  const torch::Tensor w = unit.narrow(1, 0, 1);
  const torch::Tensor u = unit.narrow(1, 1, 3);
  const torch::Tensor t = 2 * torch::linalg_cross(u, x, 1);
  return x + w * t + torch::linalg_cross(u, t, 1);
}

/// Opacity and scale factor of each of `copies` Gaussians that together replace one of `opacity`:
/// o' = 1 − (1 − o)^(1/n),  s'/s = o / Σ_{i=1..n} Σ_{k<i} C(i−1,k) (−1)^k o'^(k+1) / √(k+1).
void share(double opacity, int64_t copies, double* new_opacity, double* scale_factor) {
  const double o = std::min(opacity, 1 - 1e-7);
  const double shared = 1 - std::pow(1 - o, 1.0 / static_cast<double>(copies));
  double sum = 0;
  for (int64_t i = 1; i <= copies; ++i) {
    double binomial = 1, power = shared, sign = 1;
    for (int64_t k = 0; k < i; ++k) {
      sum += sign * binomial * power / std::sqrt(static_cast<double>(k + 1));
      binomial *= static_cast<double>(i - 1 - k) / static_cast<double>(k + 1);
      power *= shared;
      sign = -sign;
    }
  }
  *new_opacity = shared;
  *scale_factor = sum > 0 ? o / sum : 1;
}

/// Relative probability of copying each Gaussian, [N] on the CPU; zero for dead ones.
torch::Tensor copy_weights(const CopyRule& rule, const torch::Tensor& opacities) {
  const auto of_living = [&](const torch::Tensor& weights) {
    return torch::where(opacities > rule.min_opacity, weights, torch::zeros_like(weights));
  };
  if (rule.weights.defined()) {
    const torch::Tensor weights = of_living(rule.weights.to(torch::kCPU));
    if ((weights > 0).any().item<bool>()) return weights;
  }
  return of_living(opacities);
}

/// Samples the means of the rows, which are copies of Gaussians, from these and makes them smaller.
void spread_copies(const torch::Tensor& rows, splat::Gaussians* values, at::Generator& generator) {
  const torch::Tensor normal =
      at::randn({rows.size(0), 3}, generator, torch::kFloat32).to(values->means.device());
  const auto of = [&](const torch::Tensor& value) { return value.index_select(0, rows); };
  values->means.index_add_(0, rows,
                           world_offsets(of(values->rotations), of(values->log_scales), normal));
  values->log_scales.index_add_(
      0, rows, torch::full({rows.size(0), 3}, -kSplitShrink, values->log_scales.options()));
}

/// Distributes opacity and scale of the rows `chosen` (CPU int64, with repeats) over themselves and
/// their copies, in `values` on the CPU or GPU.
void share_places(const torch::Tensor& chosen, const torch::Tensor& opacities, double min_opacity,
                  splat::Gaussians* values) {
  const torch::Tensor counts = torch::bincount(chosen, {}, opacities.size(0));
  const torch::Tensor rows = counts.nonzero().squeeze(1);
  std::vector<double> logits, factors;
  for (int64_t i = 0; i < rows.size(0); ++i) {
    const int64_t row = rows.const_data_ptr<int64_t>()[i];
    const int64_t copies = std::min(counts.const_data_ptr<int64_t>()[row] + 1, kMostCopies);
    double opacity = 0, factor = 1;
    share(static_cast<double>(opacities.const_data_ptr<float>()[row]), copies, &opacity, &factor);
    opacity = std::clamp(opacity, min_opacity, 1 - 1e-6);
    logits.push_back(std::log(opacity / (1 - opacity)));
    factors.push_back(std::log(factor));
  }
  const auto device = values->means.device();
  const auto to_device = [&](const std::vector<double>& list) {
    return torch::tensor(list, torch::kFloat64).to(device, torch::kFloat32);
  };
  const torch::Tensor device_rows = rows.to(device);
  values->logit_opacities.index_copy_(0, device_rows, to_device(logits));
  values->log_scales.index_add_(0, device_rows,
                                to_device(factors).unsqueeze(1).expand({rows.size(0), 3}));
}

torch::Tensor cpu_opacities(const GaussianModel& model) {
  return model.detached().logit_opacities.sigmoid().nan_to_num(0).to(torch::kCPU).contiguous();
}

}  // namespace

torch::Tensor drawn_rows(const torch::Tensor& weights, int64_t count, at::Generator& generator) {
  const torch::Tensor sums = weights.to(torch::kFloat64).cumsum(0);
  const auto total = sums[-1].item<double>();
  const torch::Tensor places = at::rand({count}, generator, torch::kFloat64) * total;
  // The first sum beyond the sampled value; none for a value that was rounded up to the total, so
  // clamp.
  return torch::searchsorted(sums, places.clamp_max(std::nextafter(total, 0.0)),
                             /*out_int32=*/false, /*right=*/true);
}

torch::Tensor world_offsets(const torch::Tensor& rotations, const torch::Tensor& log_scales,
                            const torch::Tensor& x) {
  return rotate(rotations, log_scales.exp() * x);
}

int64_t relocate_dead(const CopyRule& rule, GaussianModel& model, GaussianAdam& adam,
                      at::Generator& generator) {
  const torch::NoGradGuard no_grad;
  const torch::Tensor opacities = cpu_opacities(model);
  const torch::Tensor dead = (opacities <= rule.min_opacity).nonzero().squeeze(1);
  if (dead.size(0) == 0 || dead.size(0) == opacities.size(0)) return 0;
  const torch::Tensor chosen = drawn_rows(copy_weights(rule, opacities), dead.size(0), generator);
  splat::Gaussians values = model.detached();  // the model's own tensors, changed in place
  share_places(chosen, opacities, rule.min_opacity, &values);
  const torch::Tensor from = chosen.to(model.device());
  const torch::Tensor into = dead.to(model.device());
  for (int i = 0; i < kParameterCount; ++i) {
    torch::Tensor& value = parameter(values, i);
    value.index_copy_(0, into, value.index_select(0, from));
  }
  if (rule.spread) spread_copies(into, &values, generator);
  adam.reset_rows(torch::cat({from, into}));
  return dead.size(0);
}

int64_t add_on_living(int64_t count, const CopyRule& rule, GaussianModel& model, GaussianAdam& adam,
                      at::Generator& generator) {
  const torch::NoGradGuard no_grad;
  const torch::Tensor opacities = cpu_opacities(model);
  const torch::Tensor weights = copy_weights(rule, opacities);
  if (count <= 0 || !(weights > 0).any().item<bool>()) return 0;
  const torch::Tensor chosen = drawn_rows(weights, count, generator);
  splat::Gaussians values = model.detached();
  share_places(chosen, opacities, rule.min_opacity, &values);
  const torch::Tensor from = chosen.to(model.device());
  adam.reset_rows(from);
  const torch::Tensor kept = torch::arange(model.size(), from.options());
  adam.gather_rows(torch::cat({kept, torch::full_like(from, -1)}));
  splat::Gaussians all = map_parameters(values, [&](const torch::Tensor& value) {
    return torch::cat({value, value.index_select(0, from)});
  });
  if (rule.spread) {
    spread_copies(torch::arange(model.size(), model.size() + count, from.options()), &all,
                  generator);
  }
  model.replace(std::move(all));
  return count;
}

void add_noise(double scale, GaussianModel& model, at::Generator& generator) {
  const torch::NoGradGuard no_grad;
  const splat::Gaussians values = model.detached();
  NoiseStep step;
  step.means = values.means.data_ptr<float>();
  step.rotations = values.rotations.const_data_ptr<float>();
  step.log_scales = values.log_scales.const_data_ptr<float>();
  step.logit_opacities = values.logit_opacities.const_data_ptr<float>();
  step.count = model.size();
  step.scale = static_cast<float>(scale);
  step.seed = draw_bits(generator);
  if (values.means.is_cuda()) {
    kernel::on_cuda("the noise of the Gaussians", [&] { cuda::add_noise(step); });
  } else {
    cpu::add_noise(step);
  }
}

}  // namespace jade::gaussians
