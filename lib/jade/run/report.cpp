// SPDX-License-Identifier: Apache-2.0
#include "jade/run/report.h"

#include <fstream>
#include <nlohmann/json.hpp>
#include <numeric>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/eval/metrics.h"
#include "jade/imaging/image_io.h"
#include "jade/restore/restorations.h"
#include "jade/run/allocation_choice.h"
#include "jade/run/evaluate.h"
#include "jade/run/report_page.h"
#include "jade/train/routing_step.h"

namespace jade::run {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

/// Pictures make the file large; this many training views are shown, spread over the sequence.
constexpr size_t kShownViews = 4;

std::string base64(const std::vector<uint8_t>& bytes) {
  constexpr char kDigits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  for (size_t i = 0; i < bytes.size(); i += 3) {
    const uint32_t left = static_cast<uint32_t>(bytes.size() - i);
    const uint32_t group =
        (bytes[i] << 16) | ((left > 1 ? bytes[i + 1] : 0) << 8) | (left > 2 ? bytes[i + 2] : 0);
    out += kDigits[group >> 18];
    out += kDigits[group >> 12 & 63];
    out += left > 1 ? kDigits[group >> 6 & 63] : '=';
    out += left > 2 ? kDigits[group & 63] : '=';
  }
  return out;
}

Json picture(const std::string& name, const torch::Tensor& image, const torch::Tensor& truth = {}) {
  Json entry{{"name", name},
             {"src", "data:image/png;base64," + base64(imaging::encode_png(image.detach().cpu()))}};
  if (truth.defined()) {
    char note[24];
    std::snprintf(note, sizeof note, "%.2f dB", eval::psnr(image, truth.to(image.device())));
    entry["note"] = note;
  }
  return entry;
}

/// The sharp test view taken at an exposure's middle, or undefined.
torch::Tensor truth_of(const data::Dataset& dataset, int64_t exposure) {
  for (const data::SharpView& view : dataset.test) {
    if (data::exposure_of(dataset, view) == exposure) return view.image;
  }
  return {};
}

Json training_view(const data::Dataset& dataset, const train::View& view, int64_t index,
                   train::TrainState& state, const splat::RenderOptions& draw) {
  const data::Exposure& exposure = dataset.train[static_cast<size_t>(index)];
  const torch::Tensor truth = truth_of(dataset, index);
  const auto render = render_view(state.gaussians.detached(), exposure.poses[geometry::kMidPose],
                                  exposure.camera, draw);
  // Count-normalised, as the correlation with α sees it.
  const auto density = (view.density / view.density.max().clamp_min(1)).unsqueeze(0);
  Json pictures = Json::array(
      {picture("blurry", view.blurry, truth), picture("EDI", view.restorations.edi, truth)});
  if (view.restorations.efnet.defined())
    pictures.push_back(picture("EFNet", view.restorations.efnet, truth));
  const auto alpha = train::allocation_map(state, view, index);
  if (alpha.defined()) {
    pictures.push_back(
        picture("α", alpha.expand({1, exposure.camera.height, exposure.camera.width})));
    pictures.push_back(picture("fused", train::scene_target(state, view, index), truth));
  }
  pictures.push_back(picture("event density", density));
  const size_t shown = pictures.size();
  pictures.push_back(picture("render", render, truth));
  if (truth.defined()) pictures.push_back(picture("truth", truth));
  return {{"name", "training view " + view.name}, {"show", shown}, {"pictures", pictures}};
}

/// Pearson's r over the pixels of one view; 0 where either side does not vary.
double correlation(const torch::Tensor& a, const torch::Tensor& b) {
  const auto x = a.flatten().to(torch::kFloat64) - a.to(torch::kFloat64).mean();
  const auto y = b.flatten().to(torch::kFloat64) - b.to(torch::kFloat64).mean();
  const double scale = std::sqrt((x.square().sum() * y.square().sum()).item<double>());
  return scale > 0 ? (x * y).sum().item<double>() / scale : 0.0;
}

/// Adds to the rows what the truths say of the choice, and returns the means over those that have
/// one.
Json choice_statistics(const data::Dataset& dataset, const std::vector<train::View>& views,
                       train::TrainState& state, Json& rows) {
  std::vector<double> right, gain;
  for (size_t i = 0; i < views.size(); ++i) {
    const auto index = static_cast<int64_t>(i);
    const torch::Tensor truth = truth_of(dataset, index);
    if (!truth.defined() || !views[i].restorations.efnet.defined()) continue;
    const AllocationChoice choice = allocation_choice(train::allocation_map(state, views[i], index),
                                                      views[i].restorations, truth);
    gain.push_back(choice.gain_db);
    if (choice.right) right.push_back(*choice.right);
    rows[i]["choice_right"] = choice.right ? Json(*choice.right) : Json(nullptr);
    rows[i]["choice_gain_db"] = choice.gain_db;
  }
  const auto mean = [](const std::vector<double>& values) {
    const double sum = std::accumulate(values.begin(), values.end(), 0.0);
    return values.empty() ? Json(nullptr) : Json(sum / static_cast<double>(values.size()));
  };
  return {{"choice_right", mean(right)}, {"choice_gain_db", mean(gain)}};
}

/// α of every training view with its correlation with event density, what sharp truths say of the
/// choice, and over all of them; views empty without an allocation. Deviations over pixels are of
/// all values, over views sample ones.
Json allocation_statistics(const data::Dataset& dataset, const std::vector<train::View>& views,
                           train::TrainState& state) {
  Json rows = Json::array();
  std::vector<torch::Tensor> maps, correlations;
  for (size_t i = 0; i < views.size(); ++i) {
    const auto alpha = train::allocation_map(state, views[i], static_cast<int64_t>(i));
    if (!alpha.defined()) return {{"views", rows}};
    const auto map =
        alpha.expand({1, views[i].density.size(0), views[i].density.size(1)}).to(torch::kFloat64);
    const double r = correlation(map[0], views[i].density);
    rows.push_back({{"name", views[i].name},
                    {"alpha_mean", map.mean().item<double>()},
                    {"alpha_std", map.std(/*unbiased=*/false).item<double>()},
                    {"alpha_min", map.min().item<double>()},
                    {"alpha_max", map.max().item<double>()},
                    {"alpha_correlation", r}});
    maps.push_back(map.cpu());
    correlations.push_back(torch::tensor(r, torch::kFloat64));
  }
  const auto all = torch::cat(maps), r = torch::stack(correlations);
  Json mean{{"alpha_mean", all.mean().item<double>()},
            {"alpha_std", all.std(/*unbiased=*/false).item<double>()},
            {"alpha_min", all.min().item<double>()},
            {"alpha_max", all.max().item<double>()},
            {"alpha_correlation", r.mean().item<double>()}};
  mean["alpha_correlation_std"] =
      views.size() > 1 ? Json(r.std(/*unbiased=*/true).item<double>()) : Json(nullptr);
  mean.update(choice_statistics(dataset, views, state, rows));
  return {{"views", rows}, {"mean", mean}};
}

Json read_metrics(const fs::path& path) {
  Json lines = Json::array();
  std::ifstream in(path);
  for (std::string line; std::getline(in, line);) {
    Json object = Json::parse(line, nullptr, /*allow_exceptions=*/false);
    if (object.is_object()) lines.push_back(std::move(object));
  }
  return lines;
}

}  // namespace

void write_report(const fs::path& run, const data::Dataset& dataset,
                  const std::vector<train::View>& views, train::TrainState& state,
                  const train::RunOptions& options) {
  const splat::RenderOptions draw = train::render_options(options);
  const torch::NoGradGuard no_grad;
  Json data;
  const Json environment = Json::parse(read_file(run / "env.json"));
  data["facts"] =
      Json::array({dataset.name, concat(dataset.train.size(), " exposures"),
                   concat(state.step, " steps"), concat(state.gaussians.size(), " Gaussians"),
                   environment["device"], environment["program"]});
  data["views"] = Json::array();
  const size_t shown = std::min(kShownViews, views.size());
  for (size_t i = 0; i < shown; ++i) {
    const size_t index = shown > 1 ? i * (views.size() - 1) / (shown - 1) : 0;
    data["views"].push_back(
        training_view(dataset, views[index], static_cast<int64_t>(index), state, draw));
  }
  data["tests"] = Json::array();
  for (const data::SharpView& view : dataset.test) {
    const auto render = render_view(state.gaussians.detached(), view.pose, view.camera, draw);
    const char* mark = !view.seen   ? ""
                       : *view.seen ? ", seen in training"
                                    : ", not seen in training";
    data["tests"].push_back(
        {{"name", concat("test view ", view.name, mark)},
         {"show", 1},
         {"pictures", {picture("render", render, view.image), picture("truth", view.image)}}});
  }
  data["evaluation"] =
      fs::exists(run / "eval.json") ? Json::parse(read_file(run / "eval.json")) : Json(nullptr);
  data["allocation"] = allocation_statistics(dataset, views, state);
  if (data["allocation"].contains("mean"))
    write_file(run / "allocation.json", data["allocation"].dump(2) + "\n");
  data["metrics"] = read_metrics(run / "metrics.jsonl");
  data["config"] = read_file(run / "config.yaml");

  std::string json = data.dump();
  // "</script>" inside a text would end the page's script.
  for (size_t at = 0; (at = json.find("</", at)) != std::string::npos; at += 3)
    json.replace(at, 2, "<\\/");
  std::string page = kReportPage;
  page.replace(page.find("@DATA@"), 6, json);
  write_file(run / "report.html", page);
}

}  // namespace jade::run
