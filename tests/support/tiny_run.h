// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "jade/core/log.h"
#include "jade/train/options.h"
#include "support/stub_restorer.h"
#include "support/temp_dir.h"
#include "support/tiny_dataset.h"

namespace jade::test {

/// A tiny data set in its own folder, which can also contain runs.
struct TinyScene {
  TempDir dir;
  std::filesystem::path data = dir.path() / "scene";

  explicit TinyScene(const TinyDatasetOptions& options = {}) {
    set_log_level("error");
    write_tiny_dataset(data, options);
  }
};

/// Twenty steps on the CPU with every feature that needs no restorer; EDI replaces it.
inline train::RunOptions tiny_options(const TinyScene& scene) {
  train::RunOptions options = train::printed_options();
  options.device = "cpu";
  options.dataset.path = scene.data;
  options.events.threshold_positive = 0.2;
  options.objective.target = losses::Target::kEdi;
  options.objective.warmup = 4;
  options.objective.simulation_start = 8;
  options.init.points = 300;
  options.densify.from = 5;
  options.densify.every = 5;
  options.densify.gradient_threshold = 1e-5;
  options.densify.max_gaussians = 500;
  options.train.iterations = options.train.calendar = 20;
  options.train.log_every = 5;
  options.train.evaluate_every = 0;
  options.train.picture_every = 0;
  options.checkpoint.every = 10;
  return options;
}

/// tiny_options with the routed target and a stub for the restorer.
inline train::RunOptions routed_options(const TinyScene& scene) {
  train::RunOptions options = tiny_options(scene);
  options.objective.target = losses::Target::kRouted;
  options.efnet.path =
      save_restorer(scene.dir / "restorer.pt", "  return 0.9 * image + 0.1 * events[:, 2:3]\n");
  options.cache.folder = scene.dir / "cache";
  return options;
}

/// routed_options with a restorer of any moment, which restores every pose.
inline train::RunOptions all_poses_options(const TinyScene& scene) {
  train::RunOptions options = routed_options(scene);
  options.objective.restored_poses = losses::RestoredPoses::kNine;
  options.efnet.path = save_any_time_restorer(
      scene.dir / "any_time.pt",
      "  t = time.view(-1, 1, 1, 1)\n"
      "  return (0.9 - 0.2 * t) * image + 0.05 * t * counts[:, 1:2] + 0.02 * counts[:, 2:3]\n");
  return options;
}

/// routed_options() with every term, including L_ev, and three SH degrees within thirty steps.
inline train::RunOptions full_options(const TinyScene& scene) {
  train::RunOptions options = routed_options(scene);
  options.objective.warmup = 6;
  options.objective.simulation_start = 12;
  options.objective.event_loss_weight = 0.1;
  options.densify.every = 10;
  options.train.iterations = options.train.calendar = 30;
  options.train.sh_degree_every = 7;
  return options;
}

}  // namespace jade::test
