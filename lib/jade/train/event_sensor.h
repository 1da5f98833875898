// SPDX-License-Identifier: Apache-2.0
// What is only roughly known of an event sensor, learned with the scene.
#pragma once

#include <cstdint>
#include <torch/nn/module.h>
#include <torch/types.h>
#include <vector>

#include "jade/core/fields.h"
#include "jade/core/steps.h"
#include "jade/data/exposure.h"
#include "jade/events/thresholds.h"
#include "jade/imaging/edi.h"
#include "jade/train/module_adam.h"

namespace jade::train {

/// The configuration group `sensor`.
struct SensorOptions {
  bool learn_thresholds = false;
  bool learn_gain = false;
  bool learn_offset = false;
  double lr = 1e-3;
  double gain_lr = 1e-4;
  double offset_lr_ms = 0.01;
  double threshold_prior = 0.1;
  double gain_prior = 0.03;
  double offset_prior_ms = 3;
  double prior_weight = 1e-4;
  Steps from = Steps::share(12);
};

template <class V>
void describe(V& v, SensorOptions& o) {
  v.field("learn_thresholds", o.learn_thresholds,
          "learn a factor of each contrast threshold; all three change R in L_edi and L_sim only");
  v.field("learn_gain", o.learn_gain, "learn a factor of both thresholds per pixel");
  v.field("learn_offset", o.learn_offset,
          "learn how far the events' clock is ahead of the frames': an event stamped t happened "
          "at t - offset");
  v.field("lr", o.lr, "Adam step size of the thresholds' logs", Range{0, 1});
  v.field("gain_lr", o.gain_lr, "Adam step size of the gains' logs", Range{0, 1});
  v.field("offset_lr_ms", o.offset_lr_ms, "Adam step size of the offset, ms", Range{0, 1e3});
  v.field("threshold_prior", o.threshold_prior,
          "standard deviation that the thresholds' logs are thought to have", Range{1e-6, 1e3});
  v.field("gain_prior", o.gain_prior, "the same of the gains' logs", Range{1e-6, 1e3});
  v.field("offset_prior_ms", o.offset_prior_ms,
          "the same of the offset, ms; events up to three of it beyond an exposure are kept, but "
          "at most one exposure",
          Range{1e-6, 1e4});
  v.field("prior_weight", o.prior_weight,
          "weight of the priors: the loss of one parameter at sqrt 2 standard deviations",
          Range{0, 1e3});
  v.field("from", o.from, "they move after this step; until then EDI is as configured",
          Range{0, 1e9});
}

/// Whether anything of the sensor is learned.
bool learns(const SensorOptions& options);

/// Moments of EDI's integral that an exposure's counts reach beyond each of its ends: one number
/// for all exposures, so that a step of any has the same shapes.
/// @param parts  of the integral, S − 1
int64_t count_margin(const SensorOptions& options, const std::vector<data::Exposure>& exposures,
                     int64_t parts);

/// Where the parameters stand, as plain numbers.
struct SensorEstimate {
  double threshold_positive = 0, threshold_negative = 0;
  double gain_std = 0;  ///< of the pixels' log gains
  double offset_ms = 0;
};

/// The thresholds Θ⁺ e^a and Θ⁻ e^b, a gain e^g of both per pixel, and the offset δ of the events'
/// clock in ms, each 0 at the start; float32. What is not learned is held there.
class EventSensor : public torch::nn::Module {
 public:
  /// @param configured  Θ⁺ and Θ⁻
  /// @param height, width  of the frames
  EventSensor(const SensorOptions& options, const events::Thresholds& configured, int64_t height,
              int64_t width);

  /// For imaging::edi_log_gain, differentiable in what is learned.
  /// @param per_ms  [] float32, how many of the exposure make one millisecond
  imaging::EdiSensor at(const torch::Tensor& per_ms) const;

  /// The term "sensor": w/2 [(a² + b²)/σ_Θ² + mean g²/σ_g² + δ²/σ_δ²] over what is learned, w
  /// prior_weight and σ the priors. [], differentiable.
  torch::Tensor prior() const;

  /// Adam over what is learned, each with its step size; the module must be on its device.
  ModuleAdam optimizer() const;

  /// Waits for the device.
  SensorEstimate estimate() const;

 private:
  SensorOptions options_;
  events::Thresholds configured_;
  torch::Tensor log_positive_, log_negative_;  ///< [], a and b
  torch::Tensor log_gain_;                     ///< [H,W], g
  torch::Tensor offset_ms_;                    ///< [], δ
};

}  // namespace jade::train
