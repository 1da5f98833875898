// SPDX-License-Identifier: Apache-2.0
// What a sensor adds to each of its frames at the same pixels: offsets of rows, columns and single
// pixels. A camera that moves tells them from the scene.
#pragma once

#include <memory>
#include <torch/nn/module.h>
#include <torch/types.h>

#include "jade/core/fields.h"
#include "jade/data/exposure.h"

namespace jade::train {

/// Whether the pattern of the sensor is learned.
enum class LearnPattern { kAuto, kOn, kOff };

constexpr auto words_of(LearnPattern) {
  return std::array{Word{"auto", LearnPattern::kAuto,
                         "dropped after 40 % of the steps where it is below 4 % of the frames' "
                         "mean brightness"},
                    Word{"on", LearnPattern::kOn}, Word{"off", LearnPattern::kOff}};
}

/// The configuration group `pattern`.
struct PatternOptions {
  LearnPattern learn = LearnPattern::kOff;
  double lr = 2e-4;
  double prior_weight = 0.5;
};

template <class V>
void describe(V& v, PatternOptions& o) {
  v.field("learn", o.learn, "learn what the sensor adds to every frame at the same pixels");
  v.field("lr", o.lr, "Adam step size of the offsets, white is 1", Range{0, 1});
  v.field(
      "prior_weight", o.prior_weight,
      "weight of the mean squared offset, which keeps the scene's brightness out of the pattern",
      Range{0, 1e3});
}

/// Offsets of all frames of one sensor.
class FixedPattern : public torch::nn::Module {
 public:
  /// @param brightness  mean of all frames, white is 1
  FixedPattern(int64_t channels, int64_t height, int64_t width, double brightness);

  const torch::Tensor& offsets() const { return offsets_; }  ///< [1 or 3,H,W] float32, learned

  /// Root mean square; waits for the device.
  double strength() const;

  /// Whether it is weak enough to be parts of the scene that move along their own edges, which
  /// would cost more than the pattern does.
  bool is_weak() const { return strength() < kLeastShare * brightness_; }

  /// Scalar, differentiable.
  torch::Tensor mean_square() const { return offsets_.square().mean(); }

 private:
  static constexpr double kLeastShare = 0.04;

  torch::Tensor offsets_;
  double brightness_;
};

/// nullptr where none is learned, and for frames of several sizes, which are not of one sensor.
std::shared_ptr<FixedPattern> make_fixed_pattern(const PatternOptions& options,
                                                 const data::Dataset& dataset);

}  // namespace jade::train
