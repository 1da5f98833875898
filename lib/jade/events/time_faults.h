// SPDX-License-Identifier: Apache-2.0
// Faults of stored event times. Private to this folder.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/events/time_survey.h"
#include "jade/events/time_unit.h"

namespace jade::events {

/// Significant bits of a floating type of that many bytes; 64 for integers.
int significant_bits(bool floating, int64_t bytes);

/// A time counter that restarted at its smallest value.
struct WrappedCounter {
  int bits = 0;       ///< width of the counter
  int64_t wraps = 0;  ///< 0: the times do not wrap
};

/// Unwraps, in place, the times of a counter of 16, 24, 31 or 32 bits. Such times span the whole
/// range of the counter and decrease only by all of it, or by the small disorder of simultaneous
/// events; other times stay as they are.
/// @param times  int64 [N] in counts
WrappedCounter unwrap_counter(torch::Tensor& times);

/// @param bits  as significant_bits()
/// @throws DataError if floating-point times at the size of `largest` are more than 1 ms apart, or
///   if `count` events lie on a few of the values that the type has there.
void check_resolution(const std::filesystem::path& path, double smallest, double largest,
                      int64_t count, int bits, TimeUnit unit);

/// @param time  float64 or int64 [N], as stored
/// @throws DataError if a thousand events or more lie on a few times, 1 ms apart or more, or all on
///   one, or if all times are whole numbers rounded to float32 at more than 1e7 events per second:
///   their last digits were lost before they were stored.
void check_digits(const std::filesystem::path& path, const torch::Tensor& time, TimeUnit unit);

/// A warning if times in the guessed unit have the rate of a recording in milliseconds: seconds
/// without a digit below the millisecond and fewer than ten events in each, or whole microseconds
/// with more events than a camera sends. Empty otherwise.
/// @param time  float64 or int64 [N], as stored
std::string milliseconds_warning(const std::filesystem::path& path, const torch::Tensor& time,
                                 TimeUnit guessed);

/// The most times that without_strays() leaves out at either end.
constexpr int64_t kMostStrays = 100;

/// The positions of sorted times without strays: one time in a thousand or fewer at either end (at
/// least 3, at most kMostStrays) that a pause longer than all the rest and than 10 s parts from it.
/// Fewer than 100 times have no strays.
/// @param head,tail  the first and last kMostStrays + 1 times, or all, in any unit
/// @param second     length of a second in that unit
Stretch without_strays(int64_t count, const std::vector<double>& head,
                       const std::vector<double>& tail, double second);

/// A warning that these many of `count` times are left out as strays; empty if none are.
std::string strays_warning(const Stretch& kept, int64_t count);

/// A warning if a single gap is nearly all of the time between the first and the last event, as one
/// damaged time causes; else empty.
/// @param t_us       int64 [N], sorted
/// @param was_sorted  false: the file had unsorted times; shorter spans are checked too
std::string lone_event_warning(const std::filesystem::path& path, const torch::Tensor& t_us,
                               bool was_sorted);

}  // namespace jade::events
