// SPDX-License-Identifier: Apache-2.0
// When each frame was exposed, from timestamps.npz.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/data/warnings.h"

namespace jade::data {

struct FrameTime {
  int64_t start_us = 0, end_us = 0;
  bool sharp() const { return start_us == end_us; }
  int64_t mid_us() const { return start_us + (end_us - start_us) / 2; }
};

struct FrameTimes {
  std::vector<FrameTime> frames;
  std::string unit;  ///< of the file
};

/// Reads the arrays timestamps_start and timestamps_end.
/// @param unit  "us", "ns", "s" or "auto": exposures last between 10 µs and 5 s, and seconds are
///              floating point.
/// @throws DataError for missing arrays, lengths that differ, values that are not finite, ends
///         before starts, or exposures of no plausible length in any unit.
FrameTimes read_frame_times(const std::filesystem::path& path, const std::string& unit);

/// Times of any integer or floating type in `unit` ("us", "ns", "s"), rounded to µs.
/// @throws DataError if they are not one list of finite values.
std::vector<int64_t> times_us(const torch::Tensor& times, const std::string& unit,
                              const std::string& name);

/// Microseconds in one `unit`: 1e-3, 1 or 1e6. @throws ConfigError for another unit.
double us_per_unit(const std::string& unit);

/// Which frames are test views.
struct Split {
  std::vector<bool> is_test;
  std::string rule;  ///< in words
};

struct SplitRule {
  std::string kind = "auto";  ///< auto, last, every, none
  int64_t last = 5;
  int64_t every = 8;
};

/// auto: the frames without exposure time. Names the pattern they form.
/// @throws DataError if no frame is left for training, or a frame without exposure time is.
Split split_frames(const std::vector<FrameTime>& times, const SplitRule& rule,
                   const std::string& path, const Warnings& warnings);

/// The same by position alone, for images without times; auto means `every`.
Split split_by_position(size_t count, const SplitRule& rule, const std::string& path);

}  // namespace jade::data
