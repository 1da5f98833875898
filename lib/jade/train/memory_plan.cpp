// SPDX-License-Identifier: Apache-2.0
#include "jade/train/memory_plan.h"

#include <algorithm>
#include <set>
#include <torch/types.h>

#include "jade/core/error.h"

namespace jade::train {
namespace {

bool begins_with(const std::string& name, const char* start) { return name.rfind(start, 0) == 0; }

}  // namespace

int64_t most_gaussians(const TrainState& state, const RunOptions& options) {
  const int64_t now = state.gaussians.size();
  const bool grows = options.densify.strategy != gaussians::DensifyStrategy::kNone;
  return grows ? std::max(now, int64_t{options.densify.max_gaussians}) : now;
}

MemoryPlan memory_plan(const std::vector<View>& views, const TrainState& state,
                       const RunOptions& options) {
  MemoryPlan plan;
  const torch::Device device = state.gaussians.device();
  std::set<const void*> counted;
  for (const View& view : views) {
    view.visit([&](const std::string& name, const torch::Tensor& tensor) {
      if (!tensor.defined() || tensor.device().type() != device.type()) return;
      if (!counted.insert(tensor.storage().data()).second) return;
      int64_t& part = begins_with(name, "blurry")                         ? plan.frames
                      : name == "edi_factors" || name == "taught_factors" ? plan.edi
                                                                          : plan.restorations;
      part += static_cast<int64_t>(tensor.storage().nbytes());
    });
  }
  int64_t values = 0;
  const auto add = [&](const std::string&, const torch::Tensor& of_all) {
    values += of_all[0].numel();
  };
  visit_tensors(add, Member{"gaussians", state.gaussians.parameters()});
  constexpr int64_t kCopies = 4;  // values, gradients, first and second moments
  plan.gaussians = most_gaussians(state, options) * values * kCopies * int64_t{sizeof(float)};
  if (!views.empty()) {
    plan.renders = 2 * options.exposure.samples * static_cast<int64_t>(views[0].blurry.nbytes());
  }
  return plan;
}

std::string text_of(const MemoryPlan& plan, size_t views, int64_t most_gaussians) {
  const auto mib = [](int64_t bytes) { return (bytes + (1 << 20) - 1) >> 20; };
  return concat(mib(plan.total()), " MiB: ", views, " frames ", mib(plan.frames), ", EDI ",
                mib(plan.edi), ", restorations ", mib(plan.restorations), ", ", most_gaussians,
                " Gaussians ", mib(plan.gaussians), ", renders ", mib(plan.renders));
}

}  // namespace jade::train
