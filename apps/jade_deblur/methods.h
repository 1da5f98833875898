// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/events/thresholds.h"

namespace jade::apps {

struct MethodOptions {
  events::Thresholds thresholds;
  /// ε of a sensor that measures log(I + ε), in units of intensity; 0 for log(I).
  double log_offset = 0;
};

struct Restoration {
  torch::Tensor latents;  ///< [9,3,H,W] at the nine poses; [4] is mid-exposure
  torch::Tensor events;   ///< [2,H,W] positive and negative events during the exposure
};

/// A way to restore an exposure. A new one is one entry of methods().
struct Method {
  std::string name;
  std::string help;
  Restoration (*restore)(const data::Exposure&, const MethodOptions&);
};

const std::vector<Method>& methods();

/// @throws ConfigError naming the methods there are.
const Method& find_method(const std::string& name);

}  // namespace jade::apps
