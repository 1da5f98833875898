// SPDX-License-Identifier: Apache-2.0
#include "jade/run/evaluate.h"

#include <torch/types.h>

#include "jade/config/config.h"
#include "jade/core/error.h"
#include "jade/core/log.h"
#include "jade/gaussians/ply.h"
#include "jade/run/checkpoint.h"
#include "jade/run/learned_cameras.h"
#include "jade/splat/render.h"
#include "jade/train/view.h"

namespace jade::run {

namespace fs = std::filesystem;

torch::Tensor render_view(const splat::Gaussians& gaussians, const geometry::Pose& pose,
                          const geometry::Intrinsics& camera, const splat::RenderOptions& options) {
  const torch::NoGradGuard no_grad;
  return splat::render(gaussians, train::camera_batch({pose}, camera, gaussians.means.device()),
                       options)
      .color[0]
      .clamp(0, 1);
}

eval::Evaluation evaluate_views(const splat::Gaussians& gaussians,
                                const std::vector<data::SharpView>& views, const eval::Lpips& lpips,
                                const splat::RenderOptions& options) {
  std::vector<eval::Scores> scores;
  for (const data::SharpView& view : views) {
    const auto render = render_view(gaussians, view.pose, view.camera, options);
    scores.push_back(eval::score(view.name, render, view.image.to(render.device()), &lpips));
    scores.back().seen = view.seen;
  }
  return eval::evaluation_of(std::move(scores));
}

train::RunOptions load_run_options(const fs::path& run) {
  if (!fs::exists(run / "config.yaml")) {
    throw DataError(concat(
        run.string(), ": expected a run directory of jade_train with its config.yaml, found none"));
  }
  auto options = config::load<train::RunOptions>({run / "config.yaml", {}, {}});
  options.device = train::RunOptions().device;
  return options;
}

data::Dataset load_run_dataset(const fs::path& run, const train::RunOptions& options) {
  std::vector<std::string> warnings;
  data::Dataset dataset = data::load_dataset(options.dataset, &warnings);
  for (const std::string& warning : warnings) log_warn(warning);
  if (fs::exists(run / kLearnedCamerasFile)) {
    read_learned_cameras(run / kLearnedCamerasFile, dataset);
    return dataset;
  }
  if (options.poses.optimize == train::PosePath::kNone) return dataset;
  if (fs::exists(run / "eval.json")) {
    throw DataError(concat((run / kLearnedCamerasFile).string(),
                           ": expected the cameras that this run has learned, found no file; "
                           "jade_train --resume writes it"));
  } else {
    log_warn(concat(run.string(), ": its poses are learned, and ", kLearnedCamerasFile,
                    " comes with the end of the run; the views stand where the data have them"));
  }
  return dataset;
}

FinishedRun open_run(const fs::path& run, const train::RunOptions& options) {
  FinishedRun opened;
  opened.dataset = load_run_dataset(run, options);
  if (fs::exists(run / "point_cloud.ply")) {
    opened.gaussians = gaussians::read_ply(run / "point_cloud.ply").gaussians;
    return opened;
  }
  const auto checkpoints = list_checkpoints(run);
  if (checkpoints.empty()) {
    throw DataError(concat(
        run.string(), ": expected point_cloud.ply or a checkpoint, found neither; train first"));
  }
  opened.gaussians = load_checkpoint_gaussians(checkpoints.front());
  return opened;
}

}  // namespace jade::run
