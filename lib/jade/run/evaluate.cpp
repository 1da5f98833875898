// SPDX-License-Identifier: Apache-2.0
#include "jade/run/evaluate.h"

#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <torch/types.h>

#include "jade/config/config.h"
#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/log.h"
#include "jade/core/text.h"
#include "jade/data/origin.h"
#include "jade/data/trained_frames.h"
#include "jade/eval/metrics.h"
#include "jade/losses/poses.h"
#include "jade/run/checkpoint.h"
#include "jade/run/learned_cameras.h"
#include "jade/run/run_directory.h"
#include "jade/splat/render.h"
#include "jade/train/exposure_span.h"
#include "jade/train/view.h"

namespace jade::run {

namespace fs = std::filesystem;

namespace {

/// fitted_gain() over the pixels that count.
double counted_gain(const torch::Tensor& image, const torch::Tensor& truth,
                    const torch::Tensor& mask) {
  if (!mask.defined()) return fitted_gain(image, truth);
  const torch::Tensor counts = mask.to(image.device(), image.scalar_type());
  return fitted_gain(image * counts, truth * counts);
}

/// The render with the brightness of the image that it is compared with.
struct Brightened {
  torch::Tensor render;
  std::optional<double> gain;  ///< unless it is that of the scene
};

Brightened as_bright(const torch::Tensor& render, const torch::Tensor& truth,
                     const torch::Tensor& mask, double gain, bool fit) {
  if (fit) gain = counted_gain(render, truth, mask);
  if (gain == 1 && !fit) return {render.clamp(0, 1), std::nullopt};
  return {(render * gain).clamp(0, 1), gain};
}

}  // namespace

torch::Tensor render_view(const splat::Gaussians& gaussians, const geometry::Pose& pose,
                          const geometry::Intrinsics& camera, const splat::RenderOptions& options) {
  const torch::NoGradGuard no_grad;
  return splat::render(gaussians, train::camera_batch({pose}, camera, gaussians.means.device()),
                       options)
      .color[0]
      .clamp(0, 1);
}

double fitted_gain(const torch::Tensor& image, const torch::Tensor& truth) {
  const torch::NoGradGuard no_grad;
  const double square = image.square().sum().item<double>();
  return square > 0 ? (image * truth).sum().item<double>() / square : 1;
}

torch::Tensor as_bright_as(const torch::Tensor& truth, const torch::Tensor& image,
                           const torch::Tensor& mask) {
  return (image * counted_gain(image, truth, mask)).clamp(0, 1);
}

eval::Evaluation evaluate_views(const splat::Gaussians& gaussians,
                                const std::vector<data::SharpView>& views, const eval::Lpips& lpips,
                                const splat::RenderOptions& options, bool fit_gain) {
  const torch::NoGradGuard no_grad;
  const torch::Device device = gaussians.means.device();
  std::vector<eval::Scores> scores;
  for (const data::SharpView& view : views) {
    const torch::Tensor truth = view.image.to(device);
    const auto render =
        splat::render(gaussians, train::camera_batch({view.pose}, view.camera, device), options)
            .color[0];
    const Brightened shown = as_bright(render, truth, view.mask, view.gain, fit_gain);
    scores.push_back(eval::score(view.name, shown.render, truth, &lpips, view.mask));
    scores.back().gain = shown.gain;
    scores.back().seen = view.seen;
  }
  return eval::evaluation_of(std::move(scores));
}

std::vector<eval::ReblurScore> evaluate_held_out(const splat::Gaussians& gaussians,
                                                 const std::vector<data::Exposure>& held_out,
                                                 const geometry::ExposureOptions& exposure,
                                                 const splat::RenderOptions& options,
                                                 bool fit_gain) {
  const torch::NoGradGuard no_grad;
  const torch::Device device = gaussians.means.device();
  const auto moments = geometry::quadrature(exposure.quadrature, exposure.samples);
  const auto weights = torch::tensor(moments.weights, torch::kFloat64).to(device);
  std::vector<eval::ReblurScore> scores;
  for (const data::Exposure& each : held_out) {
    const train::ExposureSpan span = train::span_of(each);
    std::vector<geometry::Pose> poses;
    for (const double u : moments.u) poses.push_back(span.at(u));
    const auto renders =
        splat::render(gaussians, train::camera_batch(poses, each.camera, device), options).color;
    const torch::Tensor truth = each.blurry.to(device);
    const Brightened shown =
        as_bright(losses::weighted_mean(renders, weights), truth, each.mask, each.gain, fit_gain);
    scores.push_back({each.name, eval::psnr(shown.render, truth, each.mask)});
  }
  return scores;
}

eval::Evaluation evaluate_dataset(const splat::Gaussians& gaussians, const data::Dataset& dataset,
                                  const eval::Lpips& lpips, const train::RunOptions& options) {
  const splat::RenderOptions draw = train::render_options(options);
  const bool fit_gain = train::learns_gains(options.gains, dataset);
  return eval::evaluation_of(
      evaluate_views(gaussians, dataset.test, lpips, draw, fit_gain).views,
      evaluate_held_out(gaussians, dataset.held_out, options.exposure, draw, fit_gain));
}

train::RunOptions written_options(const fs::path& run) {
  if (!fs::exists(run / "config.yaml")) {
    throw DataError(concat(
        run.string(), ": expected a run directory of jade_train with its config.yaml, found none"));
  }
  return config::load({run / "config.yaml", {}, {}}, train::printed_options());
}

train::RunOptions load_run_options(const fs::path& run) {
  train::RunOptions options = written_options(run);
  options.device = train::RunOptions().device;
  return options;
}

namespace {

data::Dataset with_poses_of(const fs::path& checkpoint, const data::Dataset& dataset,
                            const train::RunOptions& options) {
  const auto poses = train::make_exposure_poses(options.poses, dataset);
  load_checkpoint_poses(checkpoint, *poses);
  splat::Gaussians none;
  none.means = torch::zeros({0, 3});
  return with_learned_poses(dataset, *poses, none, {}, train::render_options(options));
}

/// A list in env.json; empty if it is missing.
std::vector<data::TrainedFrame> frames_in(const fs::path& run, const char* key) {
  std::vector<data::TrainedFrame> frames;
  if (!fs::exists(run / kEnvironmentFile)) return frames;
  const auto environment = nlohmann::json::parse(read_file(run / kEnvironmentFile), nullptr,
                                                 /*allow_exceptions=*/false);
  if (!environment.is_object() || !environment.contains(key)) return frames;
  for (const auto& frame : environment[key]) {
    if (frame.is_object()) frames.push_back({frame.value("name", ""), frame.value("sha256", "")});
  }
  return frames;
}

/// Warns of test views that are not those to whose images the run fitted its test poses.
void warn_of_other_views(const fs::path& run, const data::Dataset& dataset) {
  std::map<std::string, std::string> known;
  for (const data::TrainedFrame& view : frames_in(run, kTestKey)) known[view.name] = view.sha256;
  std::vector<std::string> others;
  for (const data::TrainedFrame& view : data::test_views(dataset)) {
    const auto found = known.find(view.name);
    if (found != known.end() && found->second != view.sha256) others.push_back(view.name);
  }
  if (others.empty()) return;
  log_warn(concat(dataset.root.string(), ": expected the test views to which the run fitted their ",
                  "poses, found other images or poses of ", listing(others),
                  "; train again to fit these"));
}

struct PosedData {
  data::Dataset dataset;
  fs::path checkpoint;  ///< the readable checkpoint with these poses; empty: from none
};

PosedData load_posed(const fs::path& run, const train::RunOptions& options) {
  std::vector<std::string> warnings;
  data::Dataset dataset = data::load_dataset(options.dataset, &warnings);
  for (const std::string& warning : warnings) log_warn(warning);
  if (const auto trained = frames_in(run, kTrainedKey); !trained.empty()) {
    const std::string other = data::mark_seen(trained, dataset);
    if (!other.empty()) log_warn(other);
  }
  // Settings laid over the run's say nothing about how it was trained.
  if (written_options(run).poses.optimize == train::PosePath::kNone) return {dataset, {}};
  if (fs::exists(run / kCamerasFile)) {
    warn_of_other_views(run, dataset);
    read_learned_cameras(run / kCamerasFile, dataset);
    return {dataset, {}};
  }
  if (fs::exists(run / kSceneFile)) {
    throw DataError(concat((run / kCamerasFile).string(),
                           ": expected the cameras that this run has learned, found no file; "
                           "jade_train --resume writes it"));
  }
  const auto checkpoints = list_checkpoints(run);
  if (checkpoints.empty()) {
    log_warn(concat(run.string(),
                    ": its poses are learned, and there is no checkpoint yet; the "
                    "views have the data's poses"));
    return {dataset, {}};
  }
  PosedData posed = from_newest(checkpoints, [&](const fs::path& checkpoint) -> PosedData {
    load_checkpoint_scene(checkpoint);
    return {with_poses_of(checkpoint, dataset, options), checkpoint};
  });
  log_warn(concat(
      run.string(), ": its poses are learned and not final: exposures have the poses of ",
      posed.checkpoint.filename().string(), "; test views are fitted at the end of the run"));
  return posed;
}

}  // namespace

data::Dataset load_run_dataset(const fs::path& run, const train::RunOptions& options) {
  return load_posed(run, options).dataset;
}

gaussians::GaussianFile newest_scene(const fs::path& run) {
  if (fs::exists(run / kSceneFile)) return gaussians::read_ply(run / kSceneFile);
  const auto checkpoints = list_checkpoints(run);
  if (checkpoints.empty()) {
    throw DataError(concat(run.string(), ": expected ", kSceneFile,
                           " or a checkpoint, found neither; is this the --output of jade_train?"));
  }
  return from_newest(checkpoints, load_checkpoint_scene);
}

FinishedRun open_run(const fs::path& run, const train::RunOptions& options) {
  PosedData posed = load_posed(run, options);
  // Poses and scene must be from the same step.
  gaussians::GaussianFile scene =
      posed.checkpoint.empty() ? newest_scene(run) : load_checkpoint_scene(posed.checkpoint);
  // Another data set of the same scene may have another origin.
  data::move_origin(posed.dataset, scene.origin);
  return {std::move(posed.dataset), std::move(scene.gaussians)};
}

}  // namespace jade::run
