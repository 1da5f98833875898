// SPDX-License-Identifier: Apache-2.0
// The 2D restorations alone: sharp frames from blurry ones and their events.
#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <torch/types.h>

#include "common/cli.h"
#include "common/dataset_flags.h"
#include "deblurrer.h"
#include "jade/core/atomic_file.h"
#include "jade/core/device.h"
#include "jade/core/interrupt.h"
#include "jade/core/log.h"
#include "jade/core/progress.h"
#include "jade/imaging/image_io.h"
#include "methods.h"
#include "pictures.h"
#include "scores.h"

using namespace jade;

namespace {

struct DeblurFlags {
  apps::DeblurOptions options;
  std::string method = "edi";
  bool poses = false;
  bool npy = false;
};

void add_flags(apps::Program& program, DeblurFlags& flags) {
  std::string methods;
  for (const apps::Method& method : apps::methods()) {
    methods += concat(methods.empty() ? "" : "; ", method.name, ": ", method.help);
  }
  CLI::App& cli = program.cli();
  cli.add_option("--method", flags.method, methods);
  cli.add_option("--run", flags.options.run,
                 "run directory of jade_train: its router, its settings under those given here");
  cli.add_option("--log-offset", flags.options.log_offset,
                 "offset of a sensor that measures log(I + offset), I in [0,1] (0)")
      ->check(CLI::NonNegativeNumber);
  cli.add_flag("--poses", flags.poses, "also write NAME_<k>.png for the nine poses, k 0 to 8");
  cli.add_flag("--npy", flags.npy, "also write unclamped float32 [3,H,W] beside each picture");
  apps::add_dataset_flags(program, "--dataset", "folder of the data set (that of the run)");
  program.add_key_flag("--efnet", "efnet.path",
                       "TorchScript file of the learned restorer (the one that ships)");
  program.add_key_flag("--efnet-sha256", "efnet.sha256", "SHA-256 that this file must have");
  program.add_key_flag("--threshold-positive", "events.threshold_positive",
                       "log intensity of one positive event");
  program.add_key_flag("--threshold-negative", "events.threshold_negative",
                       "of one negative event; 0: like the positive one");
  program.add_key_flag("--cache", "cache.folder",
                       "folder that keeps restorations (restorations in the user's cache folder)");
  program.add_key_switch("--no-cache", "cache.enabled", "false",
                         "neither read nor keep restorations");
}

/// Before anything is loaded.
void check_flags(const DeblurFlags& flags, const apps::Method& method,
                 const std::filesystem::path& output) {
  const train::RunOptions& settings = flags.options.settings;
  if (method.needs_run && flags.options.run.empty()) {
    throw ConfigError("--run: method router needs the run directory of jade_train");
  }
  if (settings.dataset.path.empty()) {
    throw ConfigError("--dataset: expected a folder, there or as dataset.path of --config");
  }
  if (output.empty()) throw ConfigError("--output: expected a folder for the pictures");
  if (method.needs_efnet) restore::checked_file_sha256(settings.efnet);
}

void save(const std::filesystem::path& stem, const torch::Tensor& image, bool npy) {
  imaging::write_image(stem.string() + ".png", image);
  if (npy) imaging::write_image(stem.string() + ".npy", image);
}

/// The blurry frame first, the method's own result last.
std::vector<eval::Scores> score_all(const apps::Method& method, const apps::Candidates& candidates,
                                    const torch::Tensor& truth, const eval::Lpips& lpips) {
  apps::Candidates c = candidates;
  c.truth = truth;
  std::vector<eval::Scores> scores{eval::score("blurry", c.blurry, truth, &lpips)};
  for (const apps::Method& other : apps::methods()) {
    const bool possible = c.efnet.defined() ? !other.needs_run : other.name == "edi";
    if (possible && other.name != method.name) {
      scores.push_back(eval::score(other.name, other.restore(c), truth, &lpips));
    }
  }
  scores.push_back(eval::score(method.name, method.restore(c), truth, &lpips));
  return scores;
}

struct Outcome {
  std::vector<apps::ScoredView> views;
  int64_t written = 0, without_truth = 0;
};

Outcome restore_all(const DeblurFlags& flags, const apps::Method& method,
                    const data::Dataset& dataset, const std::filesystem::path& output,
                    torch::Device device) {
  apps::Deblurrer deblurrer(flags.options, method, dataset, device);
  const eval::Lpips lpips(device);
  Outcome outcome;
  Progress progress("restoring", static_cast<int64_t>(dataset.train.size()), 0, "frames");
  for (size_t i = 0; i < dataset.train.size(); ++i) {
    throw_if_interrupted();
    const data::Exposure& exposure = dataset.train[i];
    const auto truths = apps::truths_of(dataset, i);
    if (method.needs_truth && truths.empty()) {
      ++outcome.without_truth;
      continue;
    }
    apps::Restored restored = deblurrer.restore(exposure, static_cast<int64_t>(i));
    if (!truths.empty()) restored.candidates.truth = truths.front().image;
    const torch::Tensor result = method.restore(restored.candidates);
    save(output / exposure.name, result, flags.npy);
    const auto latents = flags.poses ? deblurrer.at_all_poses(result, restored) : torch::Tensor();
    for (int64_t k = 0; flags.poses && k < geometry::kExposurePoses; ++k) {
      save(output / concat(exposure.name, "_", k), latents[k], flags.npy);
    }
    apps::write_side_pictures(output, exposure.name, restored);
    ++outcome.written;
    for (const apps::Truth& truth : truths) {
      outcome.views.push_back(
          {exposure.name, truth.name, score_all(method, restored.candidates, truth.image, lpips)});
    }
    if (progress.step()) progress.show();
  }
  return outcome;
}

ExitCode deblur(DeblurFlags flags, apps::Program& program) {
  const torch::NoGradGuard no_grad;
  const auto settings = apps::load_settings(program, flags.options.run);
  if (!settings) return ExitCode::kOk;
  flags.options.settings = *settings;
  const apps::Method& method = apps::find_method(flags.method);
  const std::filesystem::path& output = program.output();
  check_flags(flags, method, output);
  const torch::Device device =
      method.needs_efnet ? select_device(settings->device) : torch::Device(torch::kCPU);
  std::vector<std::string> warnings;
  const data::Dataset dataset = data::load_dataset(settings->dataset, &warnings);
  for (const std::string& warning : warnings) log_warn(warning);
  make_writable_folder(output);
  const Outcome outcome = restore_all(flags, method, dataset, output, device);
  if (outcome.written == 0) {
    throw DataError(concat(dataset.root.string(), ": method ", method.name,
                           " needs sharp frames at mid-exposure (sharp/, or seen test views), "
                           "found none; use mean"));
  }
  if (outcome.without_truth > 0) {
    log_warn(concat(outcome.without_truth, " of ", dataset.train.size(),
                    " exposures have no sharp truth and were left out"));
  }
  log_info(concat(outcome.written, " restored frames in ", output.string()));
  if (program.json()) {
    std::printf("%s\n", apps::to_json(method.name, outcome.views).dump(2).c_str());
  } else {
    apps::print_scores(outcome.views);
  }
  return ExitCode::kOk;
}

}  // namespace

int main(int argc, char** argv) {
  apps::Program program("jade_deblur", "Restores blurry frames with their events, without a scene");
  DeblurFlags flags;
  add_flags(program, flags);
  program.add_output_flag(
      "folder for NAME.png of each exposure, and pictures of its events and restorations in "
      "events/, edi/, efnet/, difference/, alpha/, oracle/, better/");
  program.add_device_flag();
  program.add_json_flag();
  return program.run(argc, argv, [&] { return deblur(flags, program); });
}
