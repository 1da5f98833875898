// SPDX-License-Identifier: Apache-2.0
// Plan of a step: the terms and updates that act. plan_step() alone decides it; the steps, the
// rules between settings, the benchmark and the recorded step all read the plan.
#pragma once

#include <cstdint>
#include <tuple>

#include "jade/core/members.h"
#include "jade/losses/objective.h"
#include "jade/train/options.h"

namespace jade::train {

/// Steps with equal plans do the same operations, on other numbers.
struct StepPlan {
  losses::ObjectivePlan objective;  ///< its target also rests where no allocation makes one
  bool route = false;               ///< θ takes a step
  int sh_degree = 3;                ///< of the renders
  int64_t moment_stride = 1;        ///< the exposure has every so many of its moments
  bool learned_poses = false;       ///< the exposure's cameras come from the state
  bool statistics = false;          ///< the renders feed the screen gradients of densification
  bool recordable = false;          ///< recording is wanted, and nothing depends on the host

  /// For the comparison.
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

/// Moments that a step renders, on average over the run, as a share of all.
double mean_share_of_moments(const RunOptions& options);

}  // namespace jade::train
