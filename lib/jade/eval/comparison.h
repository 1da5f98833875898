// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "jade/eval/report.h"

namespace jade::eval {

/// Everything that was compared with one sharp truth: the blurry frame first, the method's result
/// last, restorations and mixes that were at hand anyway between them.
struct ComparedView {
  std::string exposure, truth;
  std::vector<Scores> candidates;  ///< named "blurry", "edi", …
};

/// PSNR per view and candidate, then the means of all metrics, for people.
std::string to_table(const std::vector<ComparedView>& views);

/// {"method", "views": [{"name", "truth", "psnr_blurry", "psnr", "ssim_blurry", "ssim",
/// "candidates"}], "mean": {…}}; "candidates" has all metrics of each by name.
std::string to_json(const std::string& method, const std::vector<ComparedView>& views);

}  // namespace jade::eval
