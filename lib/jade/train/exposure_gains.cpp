// SPDX-License-Identifier: Apache-2.0
#include "jade/train/exposure_gains.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>
#include <vector>

namespace jade::train {

bool learns_gains(const GainOptions& options, const data::Dataset& dataset) {
  if (options.optimize != LearnGains::kAuto) return options.optimize == LearnGains::kOn;
  const std::vector<data::Exposure>& all = dataset.train;
  return std::any_of(all.begin(), all.end(), [&](const data::Exposure& exposure) {
    return exposure.gain != all.front().gain;
  });
}

ExposureGains::ExposureGains(const data::Dataset& dataset, bool learned) {
  std::vector<double> logs;
  for (const data::Exposure& exposure : dataset.train) logs.push_back(std::log(exposure.gain));
  const torch::Tensor start = torch::tensor(logs, torch::kFloat64).unsqueeze(1);
  start_ = register_buffer("start", start);
  log_gains_ = register_parameter("log_gains", start.clone(), learned);
}

torch::Tensor ExposureGains::forward(const torch::Tensor& exposure) const {
  return log_gains_.index_select(0, exposure).exp().to(torch::kFloat32).view({1});
}

torch::Tensor ExposureGains::squared_change(const torch::Tensor& exposure) const {
  const torch::Tensor change =
      log_gains_.index_select(0, exposure) - start_.index_select(0, exposure);
  return change.square().sum().to(torch::kFloat32);
}

void ExposureGains::hold_mean() {
  const torch::NoGradGuard no_grad;
  log_gains_.sub_((log_gains_ - start_).mean());
}

std::pair<double, double> ExposureGains::range() const {
  const torch::Tensor gains = log_gains_.detach().exp();
  return {gains.min().item<double>(), gains.max().item<double>()};
}

std::shared_ptr<ExposureGains> make_exposure_gains(const GainOptions& options,
                                                   const data::Dataset& dataset) {
  const bool learned = learns_gains(options, dataset);
  const bool given = std::any_of(dataset.train.begin(), dataset.train.end(),
                                 [](const data::Exposure& exposure) { return exposure.gain != 1; });
  if (!learned && !given) return nullptr;
  return std::make_shared<ExposureGains>(dataset, learned);
}

}  // namespace jade::train
