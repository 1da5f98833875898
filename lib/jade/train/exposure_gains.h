// SPDX-License-Identifier: Apache-2.0
// The brightness of each frame relative to the scene: automatic exposure changes exposure time and
// gain from frame to frame.
#pragma once

#include <memory>
#include <torch/nn/module.h>
#include <torch/types.h>
#include <utility>

#include "jade/core/fields.h"
#include "jade/data/exposure.h"

namespace jade::train {

/// Whether the frames' gains are learned.
enum class LearnGains { kAuto, kOn, kOff };

constexpr auto words_of(LearnGains) {
  return std::array{Word{"auto", LearnGains::kAuto, "if the data set has gains that differ"},
                    Word{"on", LearnGains::kOn, "start from those of the data set, or 1"},
                    Word{"off", LearnGains::kOff, "keep those of the data set"}};
}

/// The configuration group `gains`.
struct GainOptions {
  LearnGains optimize = LearnGains::kAuto;
  double lr = 1e-3;  ///< Adam step size of the gains' logs. No key
};

/// Weight of the squared distance of a log gain from the data set's: ten percent of a gain cost
/// 1e-4, a thousandth of a typical loss.
constexpr double kGainPriorWeight = 0.01;

template <class V>
void describe(V& v, GainOptions& o) {
  v.field("optimize", o.optimize, "learn the brightness of each frame relative to the scene");
  v.fixed("lr", o.lr);
  v.fixed("prior_weight", kGainPriorWeight);
}

/// Whether a run on this data set learns gains.
bool learns_gains(const GainOptions& options, const data::Dataset& dataset);

/// One gain per training exposure, as float64 logs. A factor common to all is the brightness of the
/// scene, so their mean log stays that of the data set.
class ExposureGains : public torch::nn::Module {
 public:
  ExposureGains(const data::Dataset& dataset, bool learned);

  bool learned() const { return log_gains_.requires_grad(); }

  /// The factor that makes a render of the exposure as bright as its frame, [1] float32;
  /// differentiable if learned.
  /// @param exposure  [1] int64
  torch::Tensor forward(const torch::Tensor& exposure) const;

  /// Squared distance of the exposure's log gain from the data set's, scalar float32.
  torch::Tensor squared_change(const torch::Tensor& exposure) const;

  /// Call after each update: subtracts the change of the mean log gain.
  void hold_mean();

  const torch::Tensor& log_gains() const { return log_gains_; }  ///< [V,1], the parameter
  /// The least and the largest gain; waits for the device.
  std::pair<double, double> range() const;

 private:
  torch::Tensor start_;  ///< [V,1]
  torch::Tensor log_gains_;
};

/// nullptr if every frame is as bright as the scene and no gain is learned.
std::shared_ptr<ExposureGains> make_exposure_gains(const GainOptions& options,
                                                   const data::Dataset& dataset);

}  // namespace jade::train
