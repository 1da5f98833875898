// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "jade/eval/report.h"

namespace jade::eval {

/// All images that are compared with one sharp true image: the blurry frame first, the method's
/// result last, available restorations and mixes between them.
struct ComparedView {
  std::string exposure, truth;
  std::vector<Scores> candidates;  ///< named "blurry", "edi", …
};

/// For people: PSNR per view and candidate, then the means of all metrics.
std::string to_table(const std::vector<ComparedView>& views);

/// {"method", "views": [{"name", "truth", "psnr_blurry", "psnr", "ssim_blurry", "ssim",
/// "candidates"}], "mean": {…}}; "candidates" maps each name to all of its metrics.
std::string to_json(const std::string& method, const std::vector<ComparedView>& views);

}  // namespace jade::eval
