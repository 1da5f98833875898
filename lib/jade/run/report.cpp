// SPDX-License-Identifier: Apache-2.0
#include "jade/run/report.h"

#include <ATen/Parallel.h>
#include <ctime>
#include <fstream>
#include <future>
#include <nlohmann/json.hpp>
#include <numeric>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/digest.h"
#include "jade/core/error.h"
#include "jade/core/log.h"
#include "jade/core/readable.h"
#include "jade/eval/metrics.h"
#include "jade/gaussians/gaussian_model.h"
#include "jade/gaussians/spz_file.h"
#include "jade/imaging/image_io.h"
#include "jade/page/page.h"
#include "jade/restore/restorations.h"
#include "jade/run/allocation_choice.h"
#include "jade/run/evaluate.h"
#include "jade/run/page_pictures.h"
#include "jade/run/page_scene.h"
#include "jade/run/run_directory.h"
#include "jade/run/view_pictures.h"
#include "jade/train/exposure_gains.h"
#include "jade/train/routing_step.h"

namespace jade::run {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

/// Pictures make the file large; shows this many training views, spread over the sequence.
constexpr size_t kShownViews = 4;

/// The embedded scene is more accurate than a usual .spz: SH of 7 and 6 bits reduce the error by
/// 6 dB for half as many bytes more.
constexpr gaussians::SpzOptions kEmbedded{false, 24, 7, 6};

std::string train_camera(size_t index) { return concat("train.", index); }
std::string test_camera(size_t index) { return concat("test.", index); }

/// Indices of the views to show, spread over the sequence.
std::vector<size_t> shown_views(size_t count) {
  std::vector<size_t> shown;
  const size_t wanted = std::min(kShownViews, count);
  for (size_t i = 0; i < wanted; ++i) {
    shown.push_back(wanted > 1 ? i * (count - 1) / (wanted - 1) : 0);
  }
  return shown;
}

Json training_view(const data::Dataset& dataset, const train::ViewBank& bank, size_t index,
                   train::TrainState& state, const splat::RenderOptions& draw,
                   PagePictures& pictures) {
  const auto view = static_cast<int64_t>(index);
  const torch::Tensor truth = truth_of(dataset, view), mask = truth_mask_of(dataset, view);
  const std::string camera = train_camera(index);
  Json shown = Json::array();
  for (const ViewPicture& each : training_pictures(dataset, bank, view, state, draw)) {
    shown.push_back(
        pictures.add(camera, each.name, each.make(), each.judged ? truth : torch::Tensor(), mask));
  }
  return {{"name", "training view " + dataset.train[index].name},
          {"camera", camera},
          {"pictures", shown}};
}

/// The pictures that neither steps nor fitted poses change, not yet encoded.
PagePictures known_pictures(const data::Dataset& dataset, const train::ViewBank& bank,
                            const std::vector<size_t>& shown, train::TrainState& state) {
  PagePictures pictures;
  for (const size_t index : shown) {
    for (const ViewPicture& each :
         training_pictures(dataset, bank, static_cast<int64_t>(index), state, {})) {
      if (each.fixed) pictures.add(train_camera(index), each.name, each.make());
    }
  }
  for (size_t i = 0; i < dataset.test.size(); ++i) {
    pictures.add(test_camera(i), "truth", dataset.test[i].image);
  }
  return pictures;
}

/// Mean PSNR at mid-exposure of the blurry frame, both restorations and the scene, over the views
/// with a true sharp image; null without any. EFNet is null if no target reads it.
/// @param fit_gain  whether to fit all four to the brightness of the true image, as in
///   evaluate_views()
Json headline(const data::Dataset& dataset, const train::ViewBank& bank,
              const train::TrainState& state, const splat::RenderOptions& draw, bool fit_gain) {
  int64_t count = 0;
  double blurry = 0, edi = 0, efnet = 0, rendered = 0;
  for (int64_t i = 0; i < bank.size(); ++i) {
    torch::Tensor truth = truth_of(dataset, i);
    if (!truth.defined()) continue;
    truth = truth.to(state.gaussians.device());
    const train::View view = bank.picture_view(i);
    const data::Exposure& exposure = dataset.train[static_cast<size_t>(i)];
    const torch::Tensor mask = truth_mask_of(dataset, i);
    const auto psnr = [&](const torch::Tensor& image) {
      const torch::Tensor there = image.to(truth.device());
      return eval::psnr(fit_gain ? as_bright_as(truth, there, mask) : there.clamp(0, 1), truth,
                        mask);
    };
    ++count;
    blurry += psnr(view.blurry());
    edi += psnr(view.restorations.edi);
    if (bank.has_efnet()) efnet += psnr(view.restorations.efnet);
    rendered += psnr(render_view(state.gaussians.detached(), exposure.poses[geometry::kMidPose],
                                 exposure.camera, draw));
  }
  if (count == 0) return nullptr;
  const auto n = static_cast<double>(count);
  return {{"views", count},
          {"blurry", blurry / n},
          {"edi", edi / n},
          {"efnet", bank.has_efnet() ? Json(efnet / n) : Json(nullptr)},
          {"render", rendered / n}};
}

splat::Gaussians on_cpu(splat::Gaussians gaussians) {
  for (torch::Tensor* const tensor : {&gaussians.means, &gaussians.rotations, &gaussians.log_scales,
                                      &gaussians.logit_opacities, &gaussians.sh}) {
    *tensor = tensor->cpu();
  }
  return gaussians;
}

/// The scene as embedded in the page, or empty if .spz cannot represent it: the page then shows
/// only pictures. Omits Gaussians 1,000 times as far away as the median: one of them would cost all
/// positions their last digits.
std::string packed_scene(const splat::Gaussians& gaussians) {
  constexpr double kFarthest = 1000;
  torch::Tensor near = torch::arange(gaussians.size());
  if (gaussians.size() > 0) {
    const torch::Tensor distance = gaussians.means.abs().amax(1);
    near = distance.gt(kFarthest * distance.median()).logical_not().nonzero().flatten();
  }
  if (near.numel() < gaussians.size()) {
    log_info(concat("report.html leaves out ", gaussians.size() - near.numel(),
                    " Gaussians that lie ", kFarthest, " times as far away as the median"));
  }
  try {
    return gaussians::encode_spz(
        gaussians::map_parameters(
            gaussians, [&](const torch::Tensor& value) { return value.index_select(0, near); }),
        kEmbedded, "report.html");
  } catch (const DataError& problem) {
    log_warn(concat(problem.what(), "; the report shows no scene in 3D"));
    return {};
  }
}

/// Pearson's r over the pixels of one view; 0 if either side is constant.
double correlation(const torch::Tensor& a, const torch::Tensor& b) {
  const auto x = a.flatten().to(torch::kFloat64) - a.to(torch::kFloat64).mean();
  const auto y = b.flatten().to(torch::kFloat64) - b.to(torch::kFloat64).mean();
  const double scale = std::sqrt((x.square().sum() * y.square().sum()).item<double>());
  return scale > 0 ? (x * y).sum().item<double>() / scale : 0.0;
}

/// Adds each view's statistics of the choice to its row, and returns the means over the views that
/// have one.
Json choice_statistics(const data::Dataset& dataset, const train::ViewBank& bank,
                       train::TrainState& state, Json& rows) {
  std::vector<double> right, gain;
  for (int64_t i = 0; i < bank.size(); ++i) {
    const torch::Tensor truth = truth_of(dataset, i);
    if (!truth.defined()) continue;
    const train::View view = bank.picture_view(i);
    const AllocationChoice choice =
        allocation_choice(train::allocation_map(state, view, i), view.restorations, truth);
    gain.push_back(choice.gain_db);
    if (choice.right) right.push_back(*choice.right);
    Json& row = rows[static_cast<size_t>(i)];
    row["choice_right"] = choice.right ? Json(*choice.right) : Json(nullptr);
    row["choice_gain_db"] = choice.gain_db;
  }
  const auto mean = [](const std::vector<double>& values) {
    const double sum = std::accumulate(values.begin(), values.end(), 0.0);
    return values.empty() ? Json(nullptr) : Json(sum / static_cast<double>(values.size()));
  };
  return {{"choice_right", mean(right)}, {"choice_gain_db", mean(gain)}};
}

/// α of every training view with its correlation with event density and the quality of its choice,
/// and over all of them; views is empty without an allocation. Deviations over pixels are
/// population deviations, over views sample deviations.
Json allocation_statistics(const data::Dataset& dataset, const train::ViewBank& bank,
                           train::TrainState& state) {
  Json rows = Json::array();
  std::vector<torch::Tensor> maps, correlations;
  for (int64_t i = 0; i < bank.size(); ++i) {
    const auto alpha = train::allocation_map(state, bank.picture_view(i), i);
    if (!alpha.defined()) return {{"views", rows}};
    const torch::Tensor density = bank.density(i);
    const auto map = alpha.expand({1, density.size(0), density.size(1)}).to(torch::kFloat64);
    const double r = correlation(map[0].cpu(), density);
    rows.push_back({{"name", dataset.train[static_cast<size_t>(i)].name},
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
      bank.size() > 1 ? Json(r.std(/*unbiased=*/true).item<double>()) : Json(nullptr);
  mean.update(choice_statistics(dataset, bank, state, rows));
  return {{"views", rows}, {"mean", mean}};
}

/// The date in local time, as 2026-11-26.
std::string today() {
  const std::time_t now = std::time(nullptr);
  std::tm parts{};
  char text[16];
  std::strftime(text, sizeof text, "%Y-%m-%d", localtime_r(&now, &parts));
  return text;
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

/// Results of the threads that the constructor starts.
struct Report::Begun {
  std::vector<size_t> shown;  ///< indices of the training views on the page
  std::future<std::string> scene;
  std::vector<std::future<Json>> films;  ///< events of the shown views
  std::future<PagePictures> pictures;
};

Report::Report(const data::Dataset& dataset, const train::ViewBank& bank, train::TrainState& state)
    : begun_(std::make_unique<Begun>()) {
  const torch::NoGradGuard no_grad;
  constexpr auto beside = std::launch::async;
  begun_->shown = shown_views(static_cast<size_t>(bank.size()));
  begun_->scene = std::async(beside, packed_scene, on_cpu(state.gaussians.detached()));
  for (const size_t index : begun_->shown) {
    begun_->films.push_back(
        std::async(beside, [exposure = dataset.train[index]] { return page_film(exposure); }));
  }
  begun_->pictures = std::async(
      beside, [pictures = known_pictures(dataset, bank, begun_->shown, state)]() mutable {
        pictures.encode();
        return std::move(pictures);
      });
}

Report::~Report() = default;

void Report::write(const fs::path& run, const data::Dataset& dataset, const train::ViewBank& bank,
                   train::TrainState& state, const train::RunOptions& options) {
  const splat::RenderOptions draw = train::render_options(options);
  const torch::NoGradGuard no_grad;
  Json data;
  const Json environment = Json::parse(read_file(run / "env.json"));
  data["title"] = dataset.name;
  data["facts"] = Json::array({today(), concat(dataset.train.size(), " exposures"),
                               concat(grouped(state.step), " steps"),
                               concat(grouped(state.gaussians.size()), " Gaussians"),
                               environment["device"], environment["program"]});
  PagePictures pictures = begun_->pictures.get();
  data["views"] = Json::array();
  for (const size_t index : begun_->shown) {
    data["views"].push_back(training_view(dataset, bank, index, state, draw, pictures));
  }
  data["tests"] = Json::array();
  for (size_t i = 0; i < dataset.test.size(); ++i) {
    const data::SharpView& view = dataset.test[i];
    const std::string camera = test_camera(i);
    const auto render = render_view(state.gaussians.detached(), view.pose, view.camera, draw);
    data["tests"].push_back({{"name", "test view " + view.name},
                             {"camera", camera},
                             {"seen", view.seen ? Json(*view.seen) : Json(nullptr)},
                             {"pictures",
                              {pictures.add(camera, "render", render, view.image),
                               pictures.add(camera, "truth", view.image)}}});
  }
  pictures.put_into(data["views"]);
  pictures.put_into(data["tests"]);
  for (size_t i = 0; i < begun_->shown.size(); ++i) {
    data["views"][i]["events"] = begun_->films[i].get();
  }
  data["headline"] =
      headline(dataset, bank, state, draw, train::learns_gains(options.gains, dataset));
  data["scene"] = page_scene(dataset, draw);
  data["evaluation"] =
      fs::exists(run / kScoresFile) ? Json::parse(read_file(run / kScoresFile)) : Json(nullptr);
  data["allocation"] = allocation_statistics(dataset, bank, state);
  if (data["allocation"].contains("mean"))
    write_file(run / "allocation.json", data["allocation"].dump(2) + "\n");
  data["metrics"] = read_metrics(run / "metrics.jsonl");
  data["config"] = read_file(run / "config.yaml");

  write_file(run / kReportFile,
             page::report_page(data.dump(-1, ' ', false, Json::error_handler_t::replace),
                               begun_->scene.get()));
}

}  // namespace jade::run
