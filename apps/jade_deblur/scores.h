// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "jade/eval/report.h"

namespace jade::apps {

/// Everything that was compared with one sharp truth: the blurry frame first, the method's result
/// last, restorations and mixes that were at hand anyway between them.
struct ScoredView {
  std::string exposure, truth;
  std::vector<eval::Scores> candidates;  ///< named "blurry", "edi", …
};

/// PSNR a view and candidate, then the means of all metrics.
void print_scores(const std::vector<ScoredView>& views);

/// {"method", "views": [{"name", "truth", "psnr_blurry", "psnr", "ssim_blurry", "ssim",
/// "candidates"}], "mean": {…}}; "candidates" has all metrics of each by name.
nlohmann::json to_json(const std::string& method, const std::vector<ScoredView>& views);

}  // namespace jade::apps
