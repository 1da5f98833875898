// SPDX-License-Identifier: Apache-2.0
#include "jade/train/plan.h"

#include "jade/gaussians/densify.h"
#include "jade/gaussians/gaussian_model.h"

namespace jade::train {

StepPlan plan_step(const RunOptions& options, int64_t step) {
  using router::AllocationKind;
  const AllocationKind allocation = options.allocation.kind;
  const bool routed = options.objective.target == losses::Target::kRouted;
  StepPlan plan;
  plan.objective = losses::plan_objective(options.objective, step);
  plan.objective.target &= !routed || allocation != AllocationKind::kNone;
  plan.route = plan.objective.target && routed && allocation != AllocationKind::kConstant &&
               (step - 1) % options.route.every == 0;
  plan.sh_degree = gaussians::active_sh_degree(step, options.train.sh_degree_every);
  plan.learned_poses = options.poses.optimize != PosePath::kNone;
  plan.statistics = gaussians::keeps_statistics(options.densify, step);
  plan.recordable = options.train.cuda_graph && !options.deterministic &&
                    allocation != AllocationKind::kPerViewMap;
  return plan;
}

}  // namespace jade::train
