// SPDX-License-Identifier: Apache-2.0
// A fixed pattern: the offsets that rows, columns and single pixels of a sensor add to every frame.
// Camera motion in more than one direction separates them from the scene.
#pragma once

#include <array>
#include <memory>
#include <torch/nn/module.h>
#include <torch/types.h>

#include "jade/core/fields.h"
#include "jade/core/words.h"
#include "jade/data/exposure.h"

namespace jade::train {

/// Whether the pattern is learned.
enum class LearnPattern { kAuto, kOn, kOff };

constexpr auto words_of(LearnPattern) {
  return std::array{Word{"auto", LearnPattern::kAuto,
                         "if the frames show one and the camera moves in two directions"},
                    Word{"on", LearnPattern::kOn}, Word{"off", LearnPattern::kOff}};
}

/// The configuration group `pattern`.
struct PatternOptions {
  LearnPattern learn = LearnPattern::kAuto;
  // No keys: only these values were measured.
  double lr = 2e-4;           ///< Adam step size of the offsets; white is 1
  double prior_weight = 0.5;  ///< weight of the mean squared offset, which pulls the pattern
                              ///< towards 0
};

template <class V>
void describe(V& v, PatternOptions& o) {
  v.field("learn", o.learn,
          "learn offsets per sensor pixel that all frames share, so that the scene does not model "
          "them");
}

/// Offsets that all frames of one sensor share.
class FixedPattern : public torch::nn::Module {
 public:
  FixedPattern(int64_t channels, int64_t height, int64_t width);

  const torch::Tensor& offsets() const { return offsets_; }  ///< [1 or 3,H,W] float32, learned

  /// Root mean square of the offsets; waits for the device.
  double strength() const;

  /// Scalar, differentiable.
  torch::Tensor mean_square() const { return offsets_.square().mean(); }

 private:
  torch::Tensor offsets_;
};

/// Whether to learn a pattern: as the options say, or for kAuto if data::estimate_pattern() finds
/// one.
bool learns_pattern(const PatternOptions& options, const data::Dataset& dataset);

/// nullptr if none is learned, and for frames of several sizes, which are not from one sensor.
std::shared_ptr<FixedPattern> make_fixed_pattern(const PatternOptions& options,
                                                 const data::Dataset& dataset);

}  // namespace jade::train
