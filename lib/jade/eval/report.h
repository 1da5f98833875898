// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/eval/lpips.h"

namespace jade::eval {

/// One view's scores. Metrics whose network is missing have no value, null in JSON.
struct Scores {
  std::string name;
  double psnr = 0, psnr_channel_mean = 0, ssim = 0;
  std::optional<double> lpips_alex01, lpips_vgg;
  std::optional<bool> seen =
      std::nullopt;  ///< whether training sees the scene from this pose; no value if unknown
  /// Factor that the render was multiplied by to match the view's brightness; no value: 1.
  std::optional<double> gain = std::nullopt;
  /// PSNR of the blurry frame of a held-out exposure against renders blurred along its path.
  std::optional<double> psnr_reblur = std::nullopt;
  double excluded = 0;  ///< share of masked pixels
};

/// One held-out exposure.
struct ReblurScore {
  std::string name;
  double psnr_reblur = 0;
};

struct Evaluation {
  std::vector<Scores> views;
  Scores mean;  ///< over the views; name "mean"
  /// Over the views that training has seen, and over the others; no value without any.
  std::optional<Scores> mean_seen, mean_unseen;
  std::vector<ReblurScore> held_out;  ///< their mean is mean.psnr_reblur
};

/// Both PSNRs and SSIM of one view, and LPIPS if `lpips` has its networks (nullptr: none).
/// @param mask  as in metrics.h; excluded pixels are 0 in both images for LPIPS
Scores score(const std::string& name, const torch::Tensor& image, const torch::Tensor& truth,
             const Lpips* lpips = nullptr, const torch::Tensor& mask = {});

/// Adds the means over the views and over the held-out exposures.
Evaluation evaluation_of(std::vector<Scores> views, std::vector<ReblurScore> held_out = {});

/// {"views": [{"name", "seen", "psnr", "psnr_channel_mean", "ssim", "lpips_alex01", "lpips_vgg",
/// "psnr_reblur"}], "held_out": [{"name", "psnr_reblur"}], "mean": {"psnr", …}, "mean_seen": {…},
/// "mean_unseen": {…}, "definitions": {…}}. A view that was scored with a gain has "gain", one with
/// a mask "excluded", the share of masked pixels. "seen" is true, false or null. mean_seen and
/// mean_unseen are null without such views, mean.psnr_reblur without held-out exposures, and the
/// other metrics of mean without sharp views.
std::string to_json(const Evaluation& evaluation);

/// A table for people, followed by the definition of every column.
std::string to_table(const Evaluation& evaluation);

}  // namespace jade::eval
