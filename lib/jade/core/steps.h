// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace jade {

/// A moment or a span of a run's calendar: a number of steps, or a share of the budget ("6%" in
/// YAML), so that a run of any length follows the same calendar.
class Steps {
 public:
  /// A number of steps, whatever the budget.
  Steps(int64_t count) : count_(count) {}  // NOLINT(google-explicit-constructor)

  /// `percent` of a budget, but no fewer than `at_least` steps; of 25,000 until settle() is called.
  static Steps share(double percent, int64_t at_least = 0) {
    Steps steps(0);
    steps.percent_ = percent;
    steps.at_least_ = at_least;
    steps.settle(kReferenceBudget);
    return steps;
  }

  /// Sets the value as a configuration gives it: `at_least` is kept and holds for shares only.
  void set_count(int64_t count) {
    percent_ = 0;
    count_ = count;
  }
  void set_percent(double percent) {
    percent_ = percent;
    settle(kReferenceBudget);
  }

  /// Turns a share of `budget` steps into a number of steps.
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
  /// The paper's number of steps, for which its calendar is given.
  static constexpr int64_t kReferenceBudget = 25000;

  int64_t count_;
  int64_t at_least_ = 0;
  double percent_ = 0;
};

}  // namespace jade
