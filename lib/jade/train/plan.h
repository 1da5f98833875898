// SPDX-License-Identifier: Apache-2.0
// Plan of a step: its active terms and updates. Only plan_step() decides; the steps, the rules
// between settings, the benchmark and the captured step all read the plan.
#pragma once

#include <cstdint>
#include <tuple>

#include "jade/core/members.h"
#include "jade/losses/objective.h"
#include "jade/train/options.h"

namespace jade::train {

/// Steps with equal plans run the same operations on different numbers.
struct StepPlan {
  losses::ObjectivePlan objective;
  bool route = false;          ///< θ is updated
  int sh_degree = 3;           ///< of the renders
  int64_t moment_stride = 1;   ///< every so many moments of the exposure are rendered
  bool learned_poses = false;  ///< the exposure's cameras are learned
  bool statistics = false;     ///< the renders contribute to the screen gradients of
                               ///< densification
  bool recordable = false;     ///< capture is enabled, and no operation depends on the host

  /// For operator==.
  auto members() const {
    const auto all =
        std::tie(objective, route, sh_degree, moment_stride, learned_poses, statistics, recordable);
    static_assert(std::tuple_size_v<decltype(all)> == member_count<StepPlan>());
    return all;
  }
  friend bool operator==(const StepPlan& a, const StepPlan& b) {
    return a.members() == b.members();
  }
  friend bool operator!=(const StepPlan& a, const StepPlan& b) { return !(a == b); }
};

/// @param step  counted from 1
StepPlan plan_step(const RunOptions& options, int64_t step);

/// Mean share of an exposure's moments that a step renders, over the run.
double mean_share_of_moments(const RunOptions& options);

}  // namespace jade::train
