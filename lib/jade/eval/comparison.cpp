// SPDX-License-Identifier: Apache-2.0
#include "jade/eval/comparison.h"

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>

namespace jade::eval {
namespace {

/// The mean over the views for each candidate, in the candidates' order.
std::vector<Scores> means_of(const std::vector<ComparedView>& views) {
  std::vector<Scores> means;
  for (size_t i = 0; !views.empty() && i < views.front().candidates.size(); ++i) {
    std::vector<Scores> column;
    for (const ComparedView& view : views) column.push_back(view.candidates[i]);
    means.push_back(evaluation_of(column).mean);
    means.back().name = column.front().name;
  }
  return means;
}

nlohmann::json metrics_of(const Scores& scores) {
  const auto optional = [](const std::optional<double>& value) {
    return value ? nlohmann::json(*value) : nlohmann::json(nullptr);
  };
  return {{"psnr", scores.psnr},
          {"psnr_channel_mean", scores.psnr_channel_mean},
          {"ssim", scores.ssim},
          {"lpips_alex01", optional(scores.lpips_alex01)},
          {"lpips_vgg", optional(scores.lpips_vgg)}};
}

nlohmann::json summary_of(const std::vector<Scores>& candidates) {
  nlohmann::json by_name;
  for (const Scores& scores : candidates) by_name[scores.name] = metrics_of(scores);
  return {{"psnr_blurry", candidates.front().psnr},
          {"psnr", candidates.back().psnr},
          {"ssim_blurry", candidates.front().ssim},
          {"ssim", candidates.back().ssim},
          {"candidates", by_name}};
}

/// printf to a string.
template <class... Args>
std::string text(const char* format, const Args&... args) {
  std::string out(static_cast<size_t>(std::snprintf(nullptr, 0, format, args...)), '\0');
  std::snprintf(out.data(), out.size() + 1, format, args...);
  return out;
}

std::string lpips_text(const std::optional<double>& value) {
  return value ? text("%10.4f", *value) : "         -";
}

std::string view_rows(const std::vector<ComparedView>& views) {
  size_t width = 8, truth_width = 5;
  for (const ComparedView& view : views) {
    width = std::max(width, view.exposure.size());
    truth_width = std::max(truth_width, view.truth.size());
  }
  std::string out = text("%-*s  %-*s  PSNR", int(width), "exposure", int(truth_width), "truth");
  for (const Scores& candidate : views.front().candidates) {
    out += text("%9s", candidate.name.c_str());
  }
  out += "\n";
  for (const ComparedView& view : views) {
    out += text("%-*s  %-*s      ", int(width), view.exposure.c_str(), int(truth_width),
                view.truth.c_str());
    for (const Scores& candidate : view.candidates) out += text("%9.2f", candidate.psnr);
    out += "\n";
  }
  return out;
}

}  // namespace

std::string to_table(const std::vector<ComparedView>& views) {
  if (views.empty()) {
    return "No sharp truth at mid-exposure in this data set, so there is nothing to score.\n";
  }
  std::string out = view_rows(views);
  out += text("\n%-8s %8s %8s %8s %10s %10s\n", "mean", "psnr", "gain", "ssim", "lpips_alex",
              "lpips_vgg");
  const auto means = means_of(views);
  for (const Scores& mean : means) {
    out += text("%-8s %8.2f %+8.2f %8.4f %s %s\n", mean.name.c_str(), mean.psnr,
                mean.psnr - means.front().psnr, mean.ssim, lpips_text(mean.lpips_alex01).c_str(),
                lpips_text(mean.lpips_vgg).c_str());
  }
  out +=
      "PSNR is -10 log10 of the mean squared error over all unmasked pixels and channels, in dB, "
      "images in [0,1].\n";
  if (!means.front().lpips_alex01 || !means.front().lpips_vgg) out += lpips_absent();
  return out;
}

std::string to_json(const std::string& method, const std::vector<ComparedView>& views) {
  nlohmann::json rows = nlohmann::json::array();
  for (const ComparedView& view : views) {
    nlohmann::json row = summary_of(view.candidates);
    row["name"] = view.exposure;
    row["truth"] = view.truth;
    rows.push_back(row);
  }
  nlohmann::json result = {{"method", method}, {"views", rows}, {"mean", nullptr}};
  if (!views.empty()) result["mean"] = summary_of(means_of(views));
  // File names need not be UTF-8.
  return result.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
}

}  // namespace jade::eval
