// SPDX-License-Identifier: Apache-2.0
#include "jade/eval/report.h"

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "jade/eval/metrics.h"

namespace jade::eval {
namespace {

using Json = nlohmann::ordered_json;

const std::vector<std::pair<const char*, const char*>>& definitions() {
  static const std::vector<std::pair<const char*, const char*>> list = {
      {"psnr", "-10 log10 of the mean squared error over all unmasked pixels and channels, dB"},
      {"psnr_channel_mean",
       "mean of the PSNRs of the three channels, dB (the published tables' definition)"},
      {"ssim",
       "11x11 Gaussian window, sigma 1.5, zero padding, mean over unmasked pixels and channels"},
      {"lpips_alex01", "LPIPS v0.1, AlexNet, inputs in [0,1] (the published tables' definition)"},
      {"lpips_vgg", "LPIPS v0.1, VGG16, inputs in [-1,1]"},
      {"psnr_reblur",
       "PSNR of held-out blurry frames against the mean of renders along their exposure, dB"}};
  return list;
}

template <class T>
Json or_null(const std::optional<T>& value) {
  return value ? Json(*value) : Json(nullptr);
}

Json metrics_of(const Scores& scores) {
  return {{"psnr", scores.psnr},
          {"psnr_channel_mean", scores.psnr_channel_mean},
          {"ssim", scores.ssim},
          {"lpips_alex01", or_null(scores.lpips_alex01)},
          {"lpips_vgg", or_null(scores.lpips_vgg)},
          {"psnr_reblur", or_null(scores.psnr_reblur)}};
}

/// The means over all views; without a sharp view only held-out exposures have a score.
Json mean_of_all(const Evaluation& evaluation) {
  Json mean = metrics_of(evaluation.mean);
  if (!evaluation.views.empty()) return mean;
  for (auto& [key, value] : mean.items()) {
    if (key != "psnr_reblur") value = nullptr;
  }
  return mean;
}

Json held_out_list(const Evaluation& evaluation) {
  Json list = Json::array();
  for (const ReblurScore& score : evaluation.held_out) {
    list.push_back({{"name", score.name}, {"psnr_reblur", score.psnr_reblur}});
  }
  return list;
}

Json mean_object(const std::optional<Scores>& mean) {
  return mean ? metrics_of(*mean) : Json(nullptr);
}

/// The mean of a metric; no value if any view lacks it.
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

Scores mean_over(const std::string& name, const std::vector<Scores>& views) {
  Scores mean;
  mean.name = name;
  mean.lpips_alex01 = mean_of(views, &Scores::lpips_alex01);
  mean.lpips_vgg = mean_of(views, &Scores::lpips_vgg);
  for (const Scores& view : views) {
    const double share = 1.0 / static_cast<double>(views.size());
    mean.psnr += share * view.psnr;
    mean.psnr_channel_mean += share * view.psnr_channel_mean;
    mean.ssim += share * view.ssim;
  }
  return mean;
}

/// The mean over the views that training has seen, or has not.
std::optional<Scores> mean_where(bool seen, const std::vector<Scores>& views) {
  std::vector<Scores> marked;
  for (const Scores& view : views) {
    if (view.seen == seen) marked.push_back(view);
  }
  if (marked.empty()) return std::nullopt;
  return mean_over(seen ? "mean of seen" : "mean of unseen", marked);
}

/// The name and the marks of a view.
std::string label(const Scores& scores) {
  std::string marked = scores.name + (!scores.seen ? "" : *scores.seen ? " (seen)" : " (unseen)");
  if (!scores.gain) return marked;
  char gain[32];
  std::snprintf(gain, sizeof gain, " (gain %.3f)", *scores.gain);
  return marked + gain;
}

std::string row(const Scores& scores, size_t name_width) {
  char numbers[96];
  std::snprintf(numbers, sizeof numbers, "  %8.3f  %12.3f  %7.4f", scores.psnr,
                scores.psnr_channel_mean, scores.ssim);
  const std::string name = label(scores);
  std::string line = name + std::string(name_width - name.size(), ' ') + numbers;
  for (const auto& lpips : {scores.lpips_alex01, scores.lpips_vgg}) {
    std::snprintf(numbers, sizeof numbers, "  %10.4f", lpips.value_or(0));
    line += lpips ? numbers : "           -";
  }
  return line + "\n";
}

/// The held-out exposures and their mean.
std::string reblur_table(const Evaluation& evaluation) {
  std::vector<ReblurScore> rows = evaluation.held_out;
  rows.push_back({"mean", evaluation.mean.psnr_reblur.value_or(0)});
  size_t width = 8;
  for (const ReblurScore& score : rows) width = std::max(width, score.name.size());
  std::string out = "held out" + std::string(width - 8, ' ') + "  psnr_reblur\n";
  for (const ReblurScore& score : rows) {
    char number[32];
    std::snprintf(number, sizeof number, "  %11.3f\n", score.psnr_reblur);
    out += score.name + std::string(width - score.name.size(), ' ') + number;
  }
  return out + "  psnr_reblur: " + definitions().back().second + "\n";
}

}  // namespace

Scores score(const std::string& name, const torch::Tensor& image, const torch::Tensor& truth,
             const Lpips* lpips, const torch::Tensor& mask) {
  Scores scores;
  scores.name = name;
  scores.psnr = psnr(image, truth, mask);
  scores.psnr_channel_mean = psnr_channel_mean(image, truth, mask);
  scores.ssim = ssim(image, truth, mask);
  if (lpips != nullptr) {
    const torch::Tensor a = only_counted(image, mask), b = only_counted(truth, mask);
    scores.lpips_alex01 = lpips->alex01(a, b);
    scores.lpips_vgg = lpips->vgg(a, b);
  }
  if (mask.defined()) scores.excluded = 1 - mask.sum().item<double>() / double(mask.numel());
  return scores;
}

Evaluation evaluation_of(std::vector<Scores> views, std::vector<ReblurScore> held_out) {
  Evaluation evaluation;
  evaluation.mean = mean_over("mean", views);
  if (!held_out.empty()) {
    double sum = 0;
    for (const ReblurScore& score : held_out) sum += score.psnr_reblur;
    evaluation.mean.psnr_reblur = sum / static_cast<double>(held_out.size());
  }
  evaluation.held_out = std::move(held_out);
  evaluation.mean_seen = mean_where(true, views);
  evaluation.mean_unseen = mean_where(false, views);
  evaluation.views = std::move(views);
  return evaluation;
}

std::string to_json(const Evaluation& evaluation) {
  Json views = Json::array();
  for (const Scores& scores : evaluation.views) {
    Json view{{"name", scores.name}, {"seen", or_null(scores.seen)}};
    view.update(metrics_of(scores));
    if (scores.gain) view["gain"] = *scores.gain;
    if (scores.excluded > 0) view["excluded"] = scores.excluded;
    views.push_back(std::move(view));
  }
  Json meaning;
  for (const auto& [name, text] : definitions()) meaning[name] = text;
  // File names need not be UTF-8.
  return Json{{"views", views},
              {"held_out", held_out_list(evaluation)},
              {"mean", mean_of_all(evaluation)},
              {"mean_seen", mean_object(evaluation.mean_seen)},
              {"mean_unseen", mean_object(evaluation.mean_unseen)},
              {"definitions", meaning}}
             .dump(2, ' ', false, Json::error_handler_t::replace) +
         "\n";
}

std::string to_table(const Evaluation& evaluation) {
  if (evaluation.views.empty() && !evaluation.held_out.empty()) return reblur_table(evaluation);
  std::vector<Scores> rows = evaluation.views;
  for (const auto& mean : {evaluation.mean_seen, evaluation.mean_unseen}) {
    if (mean) rows.push_back(*mean);
  }
  rows.push_back(evaluation.mean);
  size_t width = 4;
  for (const Scores& scores : rows) width = std::max(width, label(scores).size());
  std::string out = "view" + std::string(width - 4, ' ') +
                    "      psnr  psnr_channel     ssim  lpips_alex   lpips_vgg\n";
  for (const Scores& scores : rows) out += row(scores, width);
  for (const auto& [name, text] : definitions())
    if (std::string(name) != "psnr_reblur") out += std::string("  ") + name + ": " + text + "\n";
  if (std::any_of(rows.begin(), rows.end(), [](const Scores& each) { return each.gain; }))
    out += "  gain: by what the render is multiplied to be as bright as the image, then scored\n";
  if (!evaluation.held_out.empty()) out += reblur_table(evaluation);
  if (!evaluation.mean.lpips_alex01 || !evaluation.mean.lpips_vgg) out += "  " + lpips_absent();
  return out;
}

}  // namespace jade::eval
