// SPDX-License-Identifier: Apache-2.0
#include "scores.h"

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>

namespace jade::apps {
namespace {

/// The mean over the views for each candidate, in the candidates' order.
std::vector<eval::Scores> means_of(const std::vector<ScoredView>& views) {
  std::vector<eval::Scores> means;
  for (size_t i = 0; !views.empty() && i < views.front().candidates.size(); ++i) {
    std::vector<eval::Scores> column;
    for (const ScoredView& view : views) column.push_back(view.candidates[i]);
    means.push_back(eval::evaluation_of(column).mean);
    means.back().name = column.front().name;
  }
  return means;
}

nlohmann::json metrics_of(const eval::Scores& scores) {
  const auto optional = [](const std::optional<double>& value) {
    return value ? nlohmann::json(*value) : nlohmann::json(nullptr);
  };
  return {{"psnr", scores.psnr},
          {"psnr_channel_mean", scores.psnr_channel_mean},
          {"ssim", scores.ssim},
          {"lpips_alex01", optional(scores.lpips_alex01)},
          {"lpips_vgg", optional(scores.lpips_vgg)}};
}

nlohmann::json summary_of(const std::vector<eval::Scores>& candidates) {
  nlohmann::json by_name;
  for (const eval::Scores& scores : candidates) by_name[scores.name] = metrics_of(scores);
  return {{"psnr_blurry", candidates.front().psnr},
          {"psnr", candidates.back().psnr},
          {"ssim_blurry", candidates.front().ssim},
          {"ssim", candidates.back().ssim},
          {"candidates", by_name}};
}

std::string lpips_text(const std::optional<double>& value) {
  char text[32];
  std::snprintf(text, sizeof text, "%10.4f", value.value_or(0));
  return value ? text : "         -";
}

}  // namespace

void print_scores(const std::vector<ScoredView>& views) {
  if (views.empty()) {
    std::printf("No sharp truth at mid-exposure in this data set, so there is nothing to score.\n");
    return;
  }
  size_t width = 8, truth_width = 5;
  for (const ScoredView& view : views) {
    width = std::max(width, view.exposure.size());
    truth_width = std::max(truth_width, view.truth.size());
  }
  std::printf("%-*s  %-*s  PSNR", int(width), "exposure", int(truth_width), "truth");
  for (const auto& candidate : views.front().candidates) {
    std::printf("%9s", candidate.name.c_str());
  }
  std::printf("\n");
  for (const ScoredView& view : views) {
    std::printf("%-*s  %-*s      ", int(width), view.exposure.c_str(), int(truth_width),
                view.truth.c_str());
    for (const auto& candidate : view.candidates) std::printf("%9.2f", candidate.psnr);
    std::printf("\n");
  }
  std::printf("\n%-8s %8s %8s %8s %10s %10s\n", "mean", "psnr", "gain", "ssim", "lpips_alex",
              "lpips_vgg");
  const auto means = means_of(views);
  for (const eval::Scores& mean : means) {
    std::printf("%-8s %8.2f %+8.2f %8.4f %s %s\n", mean.name.c_str(), mean.psnr,
                mean.psnr - means.front().psnr, mean.ssim, lpips_text(mean.lpips_alex01).c_str(),
                lpips_text(mean.lpips_vgg).c_str());
  }
  std::printf(
      "PSNR is -10 log10 of the mean squared error over all pixels and channels, in dB, images in "
      "[0,1].\n");
  if (!means.front().lpips_alex01 || !means.front().lpips_vgg) {
    std::fputs(eval::kLpipsAbsent, stdout);
  }
}

nlohmann::json to_json(const std::string& method, const std::vector<ScoredView>& views) {
  nlohmann::json rows = nlohmann::json::array();
  for (const ScoredView& view : views) {
    nlohmann::json row = summary_of(view.candidates);
    row["name"] = view.exposure;
    row["truth"] = view.truth;
    rows.push_back(row);
  }
  nlohmann::json result = {{"method", method}, {"views", rows}, {"mean", nullptr}};
  if (!views.empty()) result["mean"] = summary_of(means_of(views));
  return result;
}

}  // namespace jade::apps
