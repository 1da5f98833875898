// SPDX-License-Identifier: Apache-2.0
#include "jade/train/evaluate.h"

#include <torch/types.h>

#include "jade/config/config.h"
#include "jade/core/error.h"
#include "jade/scene/ply.h"
#include "jade/splat/render.h"
#include "jade/train/checkpoint.h"
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
  }
  return eval::evaluation_of(std::move(scores));
}

FinishedRun open_run(const fs::path& run) {
  if (!fs::exists(run / "config.yaml")) {
    throw DataError(concat(
        run.string(), ": expected a run directory of jade_train with its config.yaml, found none"));
  }
  FinishedRun opened;
  opened.options = config::load<RunOptions>({run / "config.yaml", {}});
  opened.dataset = data::load_dataset(opened.options.dataset);
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
