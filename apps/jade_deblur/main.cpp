// SPDX-License-Identifier: Apache-2.0
// The 2D restorations alone: sharp frames from blurry ones and their events.
#include <cstdio>
#include <nlohmann/json.hpp>
#include <torch/types.h>

#include "common/cli.h"
#include "common/dataset_flags.h"
#include "jade/core/atomic_file.h"
#include "jade/core/log.h"
#include "jade/eval/metrics.h"
#include "jade/imaging/image_io.h"
#include "methods.h"
#include "pictures.h"

using namespace jade;

namespace {

struct DeblurFlags {
  data::DatasetOptions dataset;
  std::string method = "edi";
  apps::MethodOptions restoration;
  double threshold_negative = 0;
  bool poses = false;
  bool npy = false;
};

struct Score {
  std::string name, truth;
  double psnr_blurry = 0, psnr_restored = 0;
};

void add_flags(CLI::App& cli, DeblurFlags& flags) {
  std::string methods;
  for (const apps::Method& method : apps::methods()) {
    methods += concat(methods.empty() ? "" : "; ", method.name, ": ", method.help);
  }
  cli.add_option("--dataset", flags.dataset.path, "folder of the data set")->required();
  cli.add_option("--method", flags.method, methods);
  cli.add_option("--threshold-positive", flags.restoration.thresholds.positive,
                 "log intensity of one positive event (0.25)");
  cli.add_option("--threshold-negative", flags.threshold_negative,
                 "of one negative event; like the positive one unless given");
  cli.add_option("--log-offset", flags.restoration.log_offset,
                 "offset of a sensor that measures log(I + offset), I in [0,1] (0)");
  cli.add_flag("--poses", flags.poses, "also write NAME_<k>.png for the nine poses, k 0 to 8");
  cli.add_flag("--npy", flags.npy, "also write unclamped float32 [3,H,W] beside each picture");
  apps::add_dataset_flags(cli, flags.dataset);
}

void check_flags(DeblurFlags& flags) {
  auto& thresholds = flags.restoration.thresholds;
  thresholds.negative =
      flags.threshold_negative > 0 ? flags.threshold_negative : thresholds.positive;
  if (!(thresholds.positive > 0)) {
    throw ConfigError(
        concat("--threshold-positive: expected a positive number, found ", thresholds.positive));
  }
  if (!(flags.restoration.log_offset >= 0)) {
    throw ConfigError(
        concat("--log-offset: expected 0 or more, found ", flags.restoration.log_offset));
  }
}

void save(const std::filesystem::path& stem, const torch::Tensor& image, bool npy) {
  imaging::write_image(stem.string() + ".png", image);
  if (npy) imaging::write_image(stem.string() + ".npy", image);
}

void write_pictures(const std::filesystem::path& output, const data::Exposure& exposure,
                    const apps::Restoration& restoration, const DeblurFlags& flags) {
  save(output / exposure.name, restoration.latents[geometry::kMidPose], flags.npy);
  for (int64_t k = 0; flags.poses && k < geometry::kExposurePoses; ++k) {
    save(output / concat(exposure.name, "_", k), restoration.latents[k], flags.npy);
  }
  imaging::write_image(output / "events" / (exposure.name + ".png"),
                       apps::event_picture(restoration.events));
}

nlohmann::json to_json(const std::string& method, const std::vector<Score>& scores) {
  nlohmann::json views = nlohmann::json::array();
  double blurry = 0;
  double restored = 0;
  for (const Score& score : scores) {
    views.push_back({{"name", score.name},
                     {"truth", score.truth},
                     {"psnr_blurry", score.psnr_blurry},
                     {"psnr", score.psnr_restored}});
    blurry += score.psnr_blurry / double(scores.size());
    restored += score.psnr_restored / double(scores.size());
  }
  nlohmann::json result = {{"method", method}, {"views", views}, {"mean", nullptr}};
  if (!scores.empty()) result["mean"] = {{"psnr_blurry", blurry}, {"psnr", restored}};
  return result;
}

void print_scores(const std::string& method, const std::vector<Score>& scores) {
  if (scores.empty()) {
    std::printf("No sharp truth at mid-exposure in this data set, so there is nothing to score.\n");
    return;
  }
  std::printf("%-10s %-14s %10s %10s %8s\n", "exposure", "truth", "blurry", method.c_str(), "gain");
  Score mean{"mean", "", 0, 0};
  const auto row = [](const Score& score) {
    std::printf("%-10s %-14s %7.2f dB %7.2f dB %+5.2f dB\n", score.name.c_str(),
                score.truth.c_str(), score.psnr_blurry, score.psnr_restored,
                score.psnr_restored - score.psnr_blurry);
  };
  for (const Score& score : scores) {
    row(score);
    mean.psnr_blurry += score.psnr_blurry / double(scores.size());
    mean.psnr_restored += score.psnr_restored / double(scores.size());
  }
  row(mean);
  std::printf(
      "PSNR is -10 log10 of the mean squared error over all pixels and channels, images in "
      "[0,1].\n");
}

ExitCode deblur(DeblurFlags flags, const std::filesystem::path& output, bool json) {
  const torch::NoGradGuard no_grad;
  check_flags(flags);
  const apps::Method& method = apps::find_method(flags.method);
  if (output.empty()) throw ConfigError("--output: expected a folder for the pictures");
  std::vector<std::string> warnings;
  const data::Dataset dataset = data::load_dataset(flags.dataset, &warnings);
  for (const std::string& warning : warnings) log_warn(warning);
  make_writable_folder(output);
  std::vector<Score> scores;
  for (size_t i = 0; i < dataset.train.size(); ++i) {
    const data::Exposure& exposure = dataset.train[i];
    const apps::Restoration restoration = method.restore(exposure, flags.restoration);
    write_pictures(output, exposure, restoration, flags);
    for (const apps::Truth& truth : apps::truths_of(dataset, i)) {
      scores.push_back({exposure.name, truth.name, eval::psnr(exposure.blurry, truth.image),
                        eval::psnr(restoration.latents[geometry::kMidPose], truth.image)});
    }
  }
  log_info(concat(dataset.train.size(), " restored frames in ", output.string()));
  if (json) {
    std::printf("%s\n", to_json(method.name, scores).dump(2).c_str());
  } else {
    print_scores(method.name, scores);
  }
  return ExitCode::kOk;
}

}  // namespace

int main(int argc, char** argv) {
  apps::Program program("jade_deblur", "Restores blurry frames with their events, without a scene");
  DeblurFlags flags;
  add_flags(program.cli(), flags);
  program.add_output_flag("folder for NAME.png of each exposure, and events/NAME.png");
  program.add_json_flag();
  return program.run(argc, argv, [&] { return deblur(flags, program.output(), program.json()); });
}
