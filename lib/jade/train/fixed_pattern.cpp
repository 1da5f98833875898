// SPDX-License-Identifier: Apache-2.0
#include "jade/train/fixed_pattern.h"

#include <algorithm>
#include <torch/types.h>

#include "jade/data/pattern_estimate.h"

namespace jade::train {

FixedPattern::FixedPattern(int64_t channels, int64_t height, int64_t width)
    : offsets_(register_parameter("offsets", torch::zeros({channels, height, width}))) {}

double FixedPattern::strength() const {
  return offsets_.detach().square().mean().sqrt().item<double>();
}

bool learns_pattern(const PatternOptions& options, const data::Dataset& dataset) {
  if (options.learn != LearnPattern::kAuto) return options.learn == LearnPattern::kOn;
  return data::estimate_pattern(dataset).is_worth_learning();
}

std::shared_ptr<FixedPattern> make_fixed_pattern(const PatternOptions& options,
                                                 const data::Dataset& dataset) {
  if (!learns_pattern(options, dataset)) return nullptr;
  const auto& first = dataset.train.front().camera;
  const bool one_size =
      std::all_of(dataset.train.begin(), dataset.train.end(), [&](const data::Exposure& each) {
        return each.camera.width == first.width && each.camera.height == first.height;
      });
  if (!one_size) return nullptr;
  return std::make_shared<FixedPattern>(dataset.monochrome ? 1 : 3, first.height, first.width);
}

}  // namespace jade::train
