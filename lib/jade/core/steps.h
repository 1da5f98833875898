// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace jade {

/// A step of a run or a number of steps, given as a number or as a share of all steps ("6%" in
/// YAML), so that the schedule scales with the length of the run.
class Steps {
 public:
  /// A fixed number of steps.
  Steps(int64_t count) : count_(count) {}  // NOLINT(google-explicit-constructor)

  /// `percent` of the run's steps, but no fewer than `at_least`; relative to 25,000 steps until
  /// settle() is called.
  static Steps share(double percent, int64_t at_least = 0) {
    Steps steps(0);
    steps.percent_ = percent;
    steps.at_least_ = at_least;
    steps.settle(kReferenceBudget);
    return steps;
  }

  /// Sets the value from a configuration; `at_least` is kept and applies to shares only.
  void set_count(int64_t count) {
    percent_ = 0;
    count_ = count;
  }
  void set_percent(double percent) {
    percent_ = percent;
    settle(kReferenceBudget);
  }

  /// Converts a share of `budget` steps to a number of steps.
  void settle(int64_t budget) {
    if (!is_share()) return;
    const double exact = percent_ / 100 * static_cast<double>(budget);
    count_ = std::max({int64_t{1}, at_least_, static_cast<int64_t>(std::llround(exact))});
  }

  bool is_share() const { return percent_ > 0; }
  double percent() const { return percent_; }
  int64_t at_least() const { return at_least_; }
  operator int64_t() const { return count_; }  // NOLINT(google-explicit-constructor)

 private:
  /// Number of steps in the paper, to which its schedule refers.
  static constexpr int64_t kReferenceBudget = 25000;

  int64_t count_;
  int64_t at_least_ = 0;
  double percent_ = 0;
};

}  // namespace jade
