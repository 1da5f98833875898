// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/data/pattern_estimate.h"
#include "jade/data/threshold_estimate.h"

namespace jade::apps {

/// Findings of jade_inspect about a data set.
struct Inspection {
  data::Dataset dataset;
  std::vector<std::string> problems;  ///< one line each, with the fix
  data::ThresholdEstimate thresholds;
  data::PatternEstimate pattern;
  double log_offset = 0;  ///< for which the thresholds are
  std::string next;       ///< the command that trains it
};

void print_text(const Inspection& inspection);
nlohmann::json to_json(const Inspection& inspection);

}  // namespace jade::apps
