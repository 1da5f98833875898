// SPDX-License-Identifier: Apache-2.0
// All settings of a run, composed from the options of the modules.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "jade/core/auto_number.h"
#include "jade/core/fields.h"
#include "jade/data/dataset.h"
#include "jade/events/thresholds.h"
#include "jade/gaussians/densify.h"
#include "jade/gaussians/init.h"
#include "jade/gaussians/optimizer.h"
#include "jade/geometry/quadrature.h"
#include "jade/losses/objective.h"
#include "jade/losses/route.h"
#include "jade/response/camera_response.h"
#include "jade/restore/efnet.h"
#include "jade/restore/restoration_cache.h"
#include "jade/router/allocation.h"
#include "jade/train/exposure_gains.h"
#include "jade/train/exposure_poses.h"
#include "jade/train/fixed_pattern.h"

namespace jade::train {

struct TrainOptions {
  int64_t iterations = 4000;
  int64_t calendar = 0;
  Steps quarter_moments_until = Steps::share(12.5);
  Steps half_moments_until = Steps::share(20);
  int64_t log_every = 100;
  int64_t evaluate_every = 5000;
  int64_t picture_every = 5000;
  std::filesystem::path target_images;
  /// Steps until the SH degree increases by one, up to 3: 1,000 of 25,000, as in 3DGS. No key.
  Steps sh_degree_every = Steps::share(4);
  /// Captures steps on a GPU as a CUDA graph, several times faster. Has no effect with
  /// deterministic and allocation.kind per_view_map. No key: jade_bench compares both.
  bool cuda_graph = true;
};

template <class V>
void describe(V& v, TrainOptions& o) {
  v.field("iterations", o.iterations, "training steps; 25000 in the paper", Range{1, 1e8});
  v.field("calendar", o.calendar,
          "number of steps to which shares of the run (such as 6%) refer; 0: train.iterations. A "
          "resumed run keeps its initial value",
          Range{0, 1e8});
  v.field("quarter_moments_until", o.quarter_moments_until,
          "until this step render every fourth moment of an exposure (exposure.samples): 5 of 17; "
          "0: never",
          Range{0, 1e9});
  v.field("half_moments_until", o.half_moments_until,
          "then until this step every second moment: 9 of 17; 0: never", Range{0, 1e9});
  v.fixed("sh_degree_every", o.sh_degree_every);
  v.field("log_every", o.log_every, "steps between lines of metrics.jsonl", Range{1, 1e8});
  v.field("evaluate_every", o.evaluate_every,
          "steps between evaluations on the test views; 0: only at the end", Range{0, 1e8});
  v.field("picture_every", o.picture_every,
          "steps between pictures in images/ and alpha/; 0: only at the end", Range{0, 1e8});
  v.fixed("cuda_graph", o.cuda_graph);
  v.field("target_images", o.target_images,
          "folder with one image per training view, by name, for objective.target image_folder");
}

struct SplatOptions {
  double near_plane = 0;
};

template <class V>
void describe(V& v, SplatOptions& o) {
  v.field("near_plane", o.near_plane,
          "Gaussians nearer to a camera than this, in units of the scene, are not rendered; 0: "
          "chosen at the start of the run, 0.2 as in the published 3DGS, but at most half the near "
          "depth bound of the "
          "data set",
          Range{0, 1e6});
}

struct CheckpointOptions {
  int64_t every = 5000;
  /// Number of newest checkpoints to keep, so that an older one can replace a damaged one. No key.
  int64_t keep = 2;
};

template <class V>
void describe(V& v, CheckpointOptions& o) {
  v.field("every", o.every,
          "steps between checkpoints; the newest two are kept; 0: only at the end", Range{0, 1e8});
  v.fixed("keep", o.keep);
}

/// All settings of a run. Default-constructed it has the recommended settings, those of
/// configs/base.yaml; printed_options() has the paper's.
struct RunOptions {
  int64_t seed = 0;
  std::string device = "auto";
  AutoNumber memory_gib = AutoNumber::automatic(0);
  bool deterministic = false;
  data::DatasetOptions dataset;
  geometry::ExposureOptions exposure;
  events::EventOptions events;
  restore::EfnetOptions efnet;
  restore::RestorationCacheOptions cache;
  gaussians::InitOptions init;
  gaussians::OptimOptions optim;
  gaussians::DensifyOptions densify;
  SplatOptions splat;
  response::ResponseOptions response;
  PoseOptions poses;
  GainOptions gains;
  PatternOptions pattern;
  router::AllocationOptions allocation;
  losses::RouteOptions route;
  losses::ObjectiveOptions objective;
  TrainOptions train;
  CheckpointOptions checkpoint;
};

template <class V>
void describe(V& v, RunOptions& o) {
  v.field("seed", o.seed, "seed of all random numbers", Range{0, 9e15});
  v.field("device", o.device, "auto (a GPU if there is one), cpu, cuda or cuda:N");
  v.field("memory_gib", o.memory_gib,
          "GPU memory that the run may take, in GiB, at least 1; auto: what is free at the start",
          Range{1, 1e4});
  v.field("deterministic", o.deterministic,
          "bit-identical results on a GPU too, somewhat slower; on the CPU always");
  v.group("dataset", o.dataset, "where the frames, events and poses are");
  v.group("exposure", o.exposure, "the integral over an exposure");
  v.group("events", o.events, "how events become voxels and EDI");
  v.group("efnet", o.efnet, "the frozen learned restorer F");
  v.group("cache", o.cache, "restorations of the views on disk");
  v.group("init", o.init, "where the Gaussians start");
  v.group("optim", o.optim, "step sizes of the Gaussians");
  v.group("densify", o.densify, "adding and removing Gaussians");
  v.group("splat", o.splat, "how the Gaussians are rendered");
  v.group("response", o.response, "the camera response ρ");
  v.group("poses", o.poses, "the cameras of the exposures");
  v.group("gains", o.gains, "brightness of the frames of a camera with automatic exposure");
  v.group("pattern", o.pattern, "the fixed pattern of the frame sensor");
  v.group("allocation", o.allocation, "the weight between the two restorations, Eq. (3)");
  v.group("route", o.route, "routing step, Eq. (6)");
  v.renamed("crf", "response");
  v.renamed("scene", "objective");
  v.group("objective", o.objective, "objective of the scene step, Eq. (8) to (10)");
  v.group("train", o.train, "the schedule of a run");
  v.group("checkpoint", o.checkpoint, "checkpoints to resume from");
}

/// The paper's method with its inherited settings, except that densification counts all poses and
/// not only the first. It also provides the values of keys that stored settings lack: they come
/// from a version that had no such key and did as printed.
RunOptions printed_options();

/// True if the options need F(B, V): a routed, EFNet or mean target.
bool needs_efnet(const RunOptions& options);

/// Stride of the restored moments of an exposure, from the first on, for objective.restored_poses;
/// 0: only mid-exposure.
int64_t restored_every(const RunOptions& options);

/// The restored moments, 0 the start and 1 the end; empty: only mid-exposure.
std::vector<double> restored_times(const RunOptions& options);

/// The number of steps to which shares refer.
int64_t calendar_steps(const RunOptions& options);

/// Converts the schedule's shares to numbers of steps, and prevents opacity resets in the last
/// tenth of the run. Reading a configuration does it (config::load).
void settle(RunOptions& options);

/// Applies settings that a data set requires, and logs one line: a DiET-GS release has nine posed
/// images per exposure, whose mean is its blurry frame, so its exposures consist of nine equal
/// moments and EDI integrates over them.
void apply_dataset(const data::Dataset& dataset, RunOptions& options);

/// Checks rules between fields.
/// @throws ConfigError naming the keys.
void validate(const RunOptions& options);

}  // namespace jade::train
