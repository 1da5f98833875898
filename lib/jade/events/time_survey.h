// SPDX-License-Identifier: Apache-2.0
// Finds time spans in a list of times that is too long for memory.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

namespace jade::events {

/// Positions [begin, end) in a list.
struct Stretch {
  int64_t begin = 0, end = 0;
  int64_t size() const { return end - begin; }
};

/// Truncates the stretches to `most` positions in total.
void shorten(std::vector<Stretch>& stretches, int64_t most);

/// One pass over a stored list of times, in its own unit, that keeps one in 65,536 of them.
class TimeSurvey {
 public:
  /// Reads times [begin, begin + count) into `out`; integers beyond 2⁵³ lose their last digits.
  using Read = std::function<void(int64_t begin, int64_t count, double* out)>;

  /// @throws Interrupted, and what `read` throws.
  TimeSurvey(int64_t count, Read read);

  int64_t count() const { return count_; }
  /// Smallest and largest time; `finite` is false if any time is NaN.
  double smallest() const { return smallest_; }
  double largest() const { return largest_; }
  bool finite() const { return finite_; }
  bool has_fraction() const { return has_fraction_; }
  bool sorted() const { return sorted_; }

  /// Reads the times at these positions.
  std::vector<double> times(const Stretch& positions) const;

  /// Stretch of times with begin ≤ t < end. Sorted lists only.
  Stretch between(double begin, double end) const;

 private:
  int64_t first_at_or_after(double time) const;

  int64_t count_ = 0;
  Read read_;
  std::vector<double> marks_;  ///< at positions 0, 65536, …
  double smallest_, largest_;
  bool finite_ = true, has_fraction_ = false, sorted_ = true;
};

}  // namespace jade::events
