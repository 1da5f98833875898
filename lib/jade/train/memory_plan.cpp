// SPDX-License-Identifier: Apache-2.0
#include "jade/train/memory_plan.h"

#include <algorithm>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/core/readable.h"

namespace jade::train {
int64_t most_gaussians(const TrainState& state, const RunOptions& options) {
  const int64_t now = state.gaussians.size();
  const bool grows = options.densify.strategy != gaussians::DensifyStrategy::kNone;
  return grows ? std::max(now, int64_t{options.densify.max_gaussians}) : now;
}

MemoryPlan memory_plan(const ViewBank& bank, const TrainState& state, const RunOptions& options) {
  MemoryPlan plan;
  plan.constants = bank.bytes_on_device();
  int64_t values = 0;
  const auto add = [&](const std::string&, const torch::Tensor& of_all) {
    values += of_all[0].numel();
  };
  visit_tensors(add, Member{"gaussians", state.gaussians.parameters()});
  constexpr int64_t kCopies = 4;  // values, gradients, first and second moments
  plan.gaussians = most_gaussians(state, options) * values * kCopies * int64_t{sizeof(float)};
  plan.renders = 2 * options.exposure.samples * bank.frame_bytes();
  return plan;
}

std::string text_of(const MemoryPlan& plan, int64_t views, int64_t most_gaussians) {
  const auto mib = [](int64_t bytes) { return (bytes + (1 << 20) - 1) >> 20; };
  return concat(mib(plan.total()), " MiB: ", views, " frames ", mib(plan.constants.frames),
                ", EDI ", mib(plan.constants.edi), ", restorations ",
                mib(plan.constants.restorations), ", ", grouped(most_gaussians), " Gaussians ",
                mib(plan.gaussians), ", renders ", mib(plan.renders));
}

}  // namespace jade::train
