// SPDX-License-Identifier: Apache-2.0
#include "jade/train/evaluate.h"

#include <torch/types.h>

#include "jade/config/config.h"
#include "jade/core/error.h"
#include "jade/core/log.h"
#include "jade/scene/ply.h"
#include "jade/splat/render.h"
#include "jade/train/checkpoint.h"
#include "jade/train/learned_cameras.h"
#include "jade/train/view.h"

namespace jade::train {

namespace fs = std::filesystem;

torch::Tensor render_view(const splat::Gaussians& gaussians, const geometry::Pose& pose,
                          const geometry::Intrinsics& camera) {
  const torch::NoGradGuard no_grad;
  return splat::render(gaussians, camera_batch({pose}, camera, gaussians.means.device()), {})
      .color[0]
      .clamp(0, 1);
}

eval::Evaluation evaluate_views(const splat::Gaussians& gaussians,
                                const std::vector<data::SharpView>& views,
                                const eval::Lpips& lpips) {
  std::vector<eval::Scores> scores;
  for (const data::SharpView& view : views) {
    const auto render = render_view(gaussians, view.pose, view.camera);
    scores.push_back(eval::score(view.name, render, view.image.to(render.device()), &lpips));
    scores.back().seen = view.seen;
  }
  return eval::evaluation_of(std::move(scores));
}

data::Dataset load_run_dataset(const fs::path& run, const RunOptions& options) {
  data::Dataset dataset = data::load_dataset(options.dataset);
  if (options.poses.optimize == "none") return dataset;
  if (fs::exists(run / kLearnedCamerasFile)) {
    read_learned_cameras(run / kLearnedCamerasFile, dataset);
  } else if (fs::exists(run / "eval.json")) {
    throw DataError(concat((run / kLearnedCamerasFile).string(),
                           ": expected the cameras that this run has learned, found no file; "
                           "jade_train --resume writes it"));
  } else {
    log_warn(concat(run.string(), ": its poses are learned, and ", kLearnedCamerasFile,
                    " comes with the end of the run; the views stand where the data have them"));
  }
  return dataset;
}

FinishedRun open_run(const fs::path& run) {
  if (!fs::exists(run / "config.yaml")) {
    throw DataError(concat(
        run.string(), ": expected a run directory of jade_train with its config.yaml, found none"));
  }
  FinishedRun opened;
  opened.options = config::load<RunOptions>({run / "config.yaml", {}, {}});
  opened.dataset = load_run_dataset(run, opened.options);
  if (fs::exists(run / "point_cloud.ply")) {
    opened.gaussians = scene::read_ply(run / "point_cloud.ply").gaussians;
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

}  // namespace jade::train
