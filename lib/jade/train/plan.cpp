// SPDX-License-Identifier: Apache-2.0
#include "jade/train/plan.h"

#include "jade/gaussians/densify.h"
#include "jade/gaussians/gaussian_model.h"

namespace jade::train {
namespace {

/// The widest stride up to `widest`, a power of two, that keeps start, middle and end of the
/// exposure.
int64_t possible_stride(int64_t samples, int64_t widest) {
  int64_t stride = widest;
  while (stride > 1 && (samples - 1) % (2 * stride) != 0) stride /= 2;
  return stride;
}

int64_t moment_stride(const RunOptions& options, int64_t step) {
  const int64_t samples = options.exposure.samples;
  if (step <= options.train.quarter_moments_until) return possible_stride(samples, 4);
  if (step <= options.train.half_moments_until) return possible_stride(samples, 2);
  return 1;
}

}  // namespace

StepPlan plan_step(const RunOptions& options, int64_t step) {
  StepPlan plan;
  plan.objective = losses::plan_objective(options.objective, step);
  plan.route = plan.objective.target && options.objective.target == losses::Target::kRouted;
  plan.sh_degree = gaussians::active_sh_degree(step, options.train.sh_degree_every);
  plan.moment_stride = moment_stride(options, step);
  plan.learned_poses = options.poses.optimize != PosePath::kNone;
  plan.statistics = gaussians::keeps_statistics(options.densify, step);
  plan.recordable = options.train.cuda_graph && !options.deterministic &&
                    options.allocation.kind != router::AllocationKind::kPerViewMap;
  return plan;
}

double mean_share_of_moments(const RunOptions& options) {
  const int64_t steps = options.train.iterations;
  double sum = 0;
  for (int64_t step = 1; step <= steps; ++step) {
    const int64_t stride = moment_stride(options, step);
    sum += static_cast<double>((options.exposure.samples - 1) / stride + 1);
  }
  return sum / static_cast<double>(steps * options.exposure.samples);
}

}  // namespace jade::train
