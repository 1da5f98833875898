// SPDX-License-Identifier: Apache-2.0
#include "jade/eval/report.h"

#include <cstdio>
#include <nlohmann/json.hpp>

#include "jade/eval/metrics.h"

namespace jade::eval {
namespace {

using Json = nlohmann::ordered_json;

const std::vector<std::pair<const char*, const char*>>& definitions() {
  static const std::vector<std::pair<const char*, const char*>> list = {
      {"psnr", "-10 log10 of the mean squared error over all pixels and channels, dB"},
      {"psnr_channel_mean",
       "mean of the PSNRs of the three channels, dB (the published tables' definition)"},
      {"ssim", "11x11 Gaussian window, sigma 1.5, zero padding, mean over pixels and channels"},
      {"lpips_alex01", "LPIPS v0.1, AlexNet, inputs in [0,1] (the published tables' definition)"},
      {"lpips_vgg", "LPIPS v0.1, VGG16, inputs in [-1,1]"}};
  return list;
}

Json to_json_object(const Scores& scores) {
  const auto optional = [](const std::optional<double>& value) {
    return value ? Json(*value) : Json(nullptr);
  };
  return {{"name", scores.name},
          {"psnr", scores.psnr},
          {"psnr_channel_mean", scores.psnr_channel_mean},
          {"ssim", scores.ssim},
          {"lpips_alex01", optional(scores.lpips_alex01)},
          {"lpips_vgg", optional(scores.lpips_vgg)}};
}

/// The mean of a metric that every view has; absent as soon as one lacks it.
std::optional<double> mean_of(const std::vector<Scores>& views,
                              std::optional<double> Scores::*metric) {
  double sum = 0;
  for (const Scores& view : views) {
    if (!(view.*metric)) return std::nullopt;
    sum += *(view.*metric);
  }
  return views.empty() ? std::nullopt
                       : std::optional<double>(sum / static_cast<double>(views.size()));
}

std::string row(const Scores& scores, size_t name_width) {
  char numbers[96];
  std::snprintf(numbers, sizeof numbers, "  %8.3f  %12.3f  %7.4f", scores.psnr,
                scores.psnr_channel_mean, scores.ssim);
  std::string line = scores.name + std::string(name_width - scores.name.size(), ' ') + numbers;
  for (const auto& lpips : {scores.lpips_alex01, scores.lpips_vgg}) {
    std::snprintf(numbers, sizeof numbers, "  %10.4f", lpips.value_or(0));
    line += lpips ? numbers : "           -";
  }
  return line + "\n";
}

}  // namespace

Scores score(const std::string& name, const torch::Tensor& image, const torch::Tensor& truth,
             const Lpips* lpips) {
  Scores scores{
      name,         psnr(image, truth), psnr_channel_mean(image, truth), ssim(image, truth),
      std::nullopt, std::nullopt};
  if (lpips != nullptr) {
    scores.lpips_alex01 = lpips->alex01(image, truth);
    scores.lpips_vgg = lpips->vgg(image, truth);
  }
  return scores;
}

Evaluation evaluation_of(std::vector<Scores> views) {
  Scores mean{
      "mean", 0, 0, 0, mean_of(views, &Scores::lpips_alex01), mean_of(views, &Scores::lpips_vgg)};
  for (const Scores& view : views) {
    const double share = 1.0 / static_cast<double>(views.size());
    mean.psnr += share * view.psnr;
    mean.psnr_channel_mean += share * view.psnr_channel_mean;
    mean.ssim += share * view.ssim;
  }
  return {std::move(views), mean};
}

std::string to_json(const Evaluation& evaluation) {
  Json views = Json::array();
  for (const Scores& view : evaluation.views) views.push_back(to_json_object(view));
  Json mean = to_json_object(evaluation.mean);
  mean.erase("name");
  Json meaning;
  for (const auto& [name, text] : definitions()) meaning[name] = text;
  return Json{{"views", views}, {"mean", mean}, {"definitions", meaning}}.dump(2) + "\n";
}

std::string to_table(const Evaluation& evaluation) {
  size_t width = 4;
  for (const Scores& view : evaluation.views) width = std::max(width, view.name.size());
  std::string out = "view" + std::string(width - 4, ' ') +
                    "      psnr  psnr_channel     ssim  lpips_alex   lpips_vgg\n";
  for (const Scores& view : evaluation.views) out += row(view, width);
  out += row(evaluation.mean, width);
  for (const auto& [name, text] : definitions())
    out += std::string("  ") + name + ": " + text + "\n";
  if (!evaluation.mean.lpips_alex01 || !evaluation.mean.lpips_vgg)
    out += std::string("  ") + kLpipsAbsent;
  return out;
}

}  // namespace jade::eval
