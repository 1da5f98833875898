// SPDX-License-Identifier: Apache-2.0
#include "jade/train/event_sensor.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace jade::train {
namespace {

/// Events are kept so many standard deviations of the offset beyond an exposure.
constexpr double kReach = 3;

}  // namespace

bool learns(const SensorOptions& options) {
  return options.learn_thresholds || options.learn_gain || options.learn_offset;
}

int64_t count_margin(const SensorOptions& options, const std::vector<data::Exposure>& exposures,
                     int64_t parts) {
  if (!options.learn_offset) return 0;
  double shortest_us = std::numeric_limits<double>::infinity();
  for (const data::Exposure& exposure : exposures) {
    if (exposure.duration_us() <= 0) continue;
    shortest_us = std::min(shortest_us, static_cast<double>(exposure.duration_us()));
  }
  const double reach = kReach * options.offset_prior_ms * 1000 / shortest_us;
  return static_cast<int64_t>(std::ceil(std::min(1.0, reach) * static_cast<double>(parts)));
}

EventSensor::EventSensor(const SensorOptions& options, const events::Thresholds& configured,
                         int64_t height, int64_t width)
    : options_(options), configured_(configured) {
  const auto zeros = [](torch::IntArrayRef shape) { return torch::zeros(shape, torch::kFloat32); };
  log_positive_ = register_parameter("log_positive", zeros({}), options.learn_thresholds);
  log_negative_ = register_parameter("log_negative", zeros({}), options.learn_thresholds);
  log_gain_ = register_parameter("log_gain", zeros({height, width}), options.learn_gain);
  offset_ms_ = register_parameter("offset_ms", zeros({}), options.learn_offset);
}

imaging::EdiSensor EventSensor::at(const torch::Tensor& per_ms) const {
  return {log_positive_.exp() * configured_.positive, log_negative_.exp() * configured_.negative,
          log_gain_, offset_ms_ * per_ms};
}

torch::Tensor EventSensor::prior() const {
  const auto in_deviations = [](const torch::Tensor& parameter, double deviation) {
    return (parameter / deviation).square().mean();
  };
  std::vector<torch::Tensor> terms;
  if (options_.learn_thresholds) {
    terms.push_back(in_deviations(log_positive_, options_.threshold_prior));
    terms.push_back(in_deviations(log_negative_, options_.threshold_prior));
  }
  if (options_.learn_gain) terms.push_back(in_deviations(log_gain_, options_.gain_prior));
  if (options_.learn_offset) terms.push_back(in_deviations(offset_ms_, options_.offset_prior_ms));
  return torch::stack(terms).sum() * (0.5 * options_.prior_weight);
}

ModuleAdam EventSensor::optimizer() const {
  std::vector<torch::Tensor> parameters;
  std::vector<double> step_sizes;
  const auto add = [&](const torch::Tensor& parameter, double lr) {
    if (!parameter.requires_grad()) return;
    parameters.push_back(parameter);
    step_sizes.push_back(lr);
  };
  add(log_positive_, options_.lr);
  add(log_negative_, options_.lr);
  add(log_gain_, options_.gain_lr);
  add(offset_ms_, options_.offset_lr_ms);
  // The loss is a mean over pixels, so the gradient of one pixel's gain is far below Adam's 1e-8.
  return {std::move(parameters), std::move(step_sizes), 1e-15};
}

SensorEstimate EventSensor::estimate() const {
  return {configured_.positive * std::exp(log_positive_.item<double>()),
          configured_.negative * std::exp(log_negative_.item<double>()),
          log_gain_.std(/*unbiased=*/false).item<double>(), offset_ms_.item<double>()};
}

}  // namespace jade::train
