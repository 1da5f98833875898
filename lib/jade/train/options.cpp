// SPDX-License-Identifier: Apache-2.0
#include "jade/train/options.h"

#include "jade/core/error.h"
#include "jade/core/log.h"
#include "jade/train/plan.h"

namespace jade::train {
namespace {

/// Whether the exposure is the sum of nine moments printed in the paper.
bool has_nine_equal_moments(const RunOptions& options) {
  return options.exposure.samples == geometry::kExposurePoses && options.events.edi_samples == 0 &&
         options.exposure.quadrature == geometry::QuadratureRule::kEqual;
}

/// Checks that the other options support objective.restored_poses other than middle.
void validate_restored_poses(const RunOptions& options) {
  const losses::RestoredPoses poses = options.objective.restored_poses;
  if (poses == losses::RestoredPoses::kMiddle) return;
  const losses::Target target = options.objective.target;
  if (target == losses::Target::kBlurry || target == losses::Target::kImageFolder) {
    throw ConfigError(
        concat("objective.restored_poses ", word_of(poses),
               ": expected a target that is restored (routed, edi, efnet or mean), found ",
               word_of(target), ", which is of mid-exposure only; set restored_poses middle"));
  }
}

}  // namespace

RunOptions printed_options() {
  RunOptions options;
  options.exposure = {geometry::QuadratureRule::kEqual, geometry::kExposurePoses};
  options.events.edi_samples = 0;
  options.events.ramp_ms = 0;
  options.objective.target = losses::Target::kRouted;
  options.objective.target_until = 0;
  options.objective.restored_poses = losses::RestoredPoses::kMiddle;
  options.objective.edi_weight_final = -1;
  options.objective.edi_contrast = 1;
  options.objective.trust.agreement = 0;
  options.response.enabled = true;
  options.pattern.learn = LearnPattern::kOff;
  options.poses.optimize = PosePath::kNone;
  options.poses.start = PoseStart::kLine;
  options.poses.control_poses = 4;
  options.poses.lr = 1e-3;
  options.init.kind = gaussians::InitKind::kSfmOrRandom;
  options.optim.position_lr_start = 1.6e-4;
  options.optim.sh_dc_lr = 2.5e-3;
  options.optim.opacity_lr = 0.05;
  options.optim.scale_lr = 5e-3;
  options.optim.rotation_lr = 1e-3;
  options.densify.strategy = gaussians::DensifyStrategy::kAdc;
  options.densify.max_gaussians = 1000000;
  options.densify.mcmc.copies = gaussians::McmcCopies::kStacked;
  options.train.iterations = 25000;
  options.train.quarter_moments_until = 0;
  options.train.half_moments_until = 0;
  return options;
}

bool needs_efnet(const RunOptions& options) {
  const losses::Target target = options.objective.target;
  return target == losses::Target::kEfnet || target == losses::Target::kMean ||
         target == losses::Target::kRouted;
}

int64_t restored_every(const RunOptions& options) {
  const int64_t steps = options.exposure.samples - 1;
  switch (options.objective.restored_poses) {
    case losses::RestoredPoses::kMiddle:
      return 0;
    case losses::RestoredPoses::kThree:
      return steps / 2;
    case losses::RestoredPoses::kNine:
      break;
  }
  return steps % 8 == 0 ? steps / 8 : 1;
}

std::vector<double> restored_times(const RunOptions& options) {
  std::vector<double> times;
  const auto every = static_cast<size_t>(restored_every(options));
  if (every == 0) return times;
  const auto u = geometry::quadrature(options.exposure.quadrature, options.exposure.samples).u;
  for (size_t k = 0; k < u.size(); k += every) times.push_back(u[k]);
  return times;
}

int64_t calendar_steps(const RunOptions& options) {
  return options.train.calendar > 0 ? options.train.calendar : options.train.iterations;
}

void settle(RunOptions& options) {
  const int64_t budget = calendar_steps(options);
  const FieldList fields = fields_of(options);
  for (const Field& field : fields.fields()) {
    if (const auto* steps = std::get_if<Steps*>(&field.value)) (*steps)->settle(budget);
  }
  for (Steps* steps : {&options.densify.from, &options.densify.opacity_reset_every,
                       &options.objective.simulation_start, &options.optim.position_lr_max_steps,
                       &options.poses.lr_max_steps, &options.train.sh_degree_every}) {
    steps->settle(budget);
  }
  options.densify.last_opacity_reset = options.train.iterations * 9 / 10;
}

void apply_dataset(const data::Dataset& dataset, RunOptions& options) {
  if (dataset.kind != data::DatasetKind::kDietGs || has_nine_equal_moments(options)) return;
  log_info(concat(dataset.name,
                  ": nine posed images per exposure, so exposure.quadrature is equal, "
                  "exposure.samples 9 and events.edi_samples 0"));
  options.exposure.quadrature = geometry::QuadratureRule::kEqual;
  options.exposure.samples = geometry::kExposurePoses;
  options.events.edi_samples = 0;
}

void validate(const RunOptions& options) {
  validate_restored_poses(options);
  if (options.exposure.samples % 2 == 0) {
    throw ConfigError(
        concat("exposure.samples: expected an odd number (the middle one is mid-exposure), found ",
               options.exposure.samples));
  }
  if (options.events.edi_samples != 0 &&
      (options.events.edi_samples % 2 == 0 || options.events.edi_samples < 3)) {
    throw ConfigError(concat("events.edi_samples: expected 0 or an odd number of 3 or more, found ",
                             options.events.edi_samples));
  }
  if (plan_step(options, 1).route && !options.route.render_consistency &&
      !options.route.reblur_consistency) {
    throw ConfigError(concat(
        "route.render_consistency and route.reblur_consistency: at least one must be true to train "
        "allocation.kind ",
        word_of(options.allocation.kind), "; or set objective.target edi, efnet or mean"));
  }
  for (const int64_t step : {int64_t{1}, options.objective.target_until + 1}) {
    if (plan_step(options, step).objective.any_term() || step > options.train.iterations) continue;
    throw ConfigError(
        concat("objective: expected a term that acts at step ", step,
               ", found none; turn on objective.blur or objective.edi_supervision, or "
               "change objective.target, objective.target_until"));
  }
  if (options.objective.target == losses::Target::kImageFolder &&
      options.train.target_images.empty()) {
    throw ConfigError(
        "train.target_images: needed by objective.target image_folder; name a folder of images");
  }
  const gaussians::DensifyOptions& densify = options.densify;
  // In a run of a few steps both shares may round to the same step; it then has no densification.
  const bool in_order =
      densify.from < densify.until || (densify.from == densify.until && densify.until.is_share());
  if (!in_order && densify.strategy != gaussians::DensifyStrategy::kNone && densify.until > 0) {
    throw ConfigError(concat("densify.until: expected 0 or a step after ", densify.from,
                             ", the first densification (2 % of the run), found ", densify.until));
  }
}

}  // namespace jade::train
