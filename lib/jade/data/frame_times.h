// SPDX-License-Identifier: Apache-2.0
// When each frame was exposed, from timestamps.npz.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/data/dataset.h"
#include "jade/data/warnings.h"
#include "jade/events/time_unit.h"

namespace jade::data {

struct FrameTime {
  int64_t start_us = 0, end_us = 0;
  bool sharp() const { return start_us == end_us; }
  int64_t mid_us() const { return start_us + (end_us - start_us) / 2; }
};

struct FrameTimes {
  std::vector<FrameTime> frames;
  events::TimeUnit unit = events::TimeUnit::kUs;  ///< of the file
};

/// Reads the arrays timestamps_start and timestamps_end.
/// @param unit  kAuto: as events::guess_exposure_unit
/// @throws DataError for missing arrays, lengths that differ, values that are not finite, ends
///   before starts, exposures of no plausible length in any unit, or floating-point numbers that
///   are too coarse for their times.
FrameTimes read_frame_times(const std::filesystem::path& path, events::TimeUnit unit);

/// Checks for exposures that one sensor cannot have taken. Warns if a few overlap, or if
/// the times lost digits.
/// @param names  of the frames, at least as many as times
/// @param path   of the times, for messages
/// @throws DataError if two frames have the same exposure, or if more than a tenth of the exposures
///   overlap the next by more than 5 % of the frame period, which rounding cannot explain.
void check_apart(const std::vector<FrameTime>& times, const std::vector<std::string>& names,
                 const std::string& path, const Warnings& warnings);

/// A note if the times were recognised as ms; else empty.
/// @param wanted  the unit of the options
std::string milliseconds_note(const FrameTimes& times, events::TimeUnit wanted,
                              const std::filesystem::path& path);

/// Which frames are test views.
struct Split {
  std::vector<bool> is_test;
  std::string rule;  ///< in words
};

struct SplitRule {
  SplitKind kind = SplitKind::kAuto;
  int64_t last = 5;
  int64_t every = 8;
  std::string source;  ///< what says so, if not the options
};

/// kAuto: frames without exposure time are test views; describes the pattern that they form.
/// @throws DataError if no training frame remains, or if a training frame has no exposure time.
Split split_frames(const std::vector<FrameTime>& times, const SplitRule& rule,
                   const std::string& path, const Warnings& warnings);

/// The options' rule for images without times. With kAuto, a file "hold=N" in the folder, which
/// Deblur-NeRF and its successors have, means that frames 0, N, 2 N, … are test views. Warns of
/// such a file that cannot be followed.
SplitRule position_rule(const DatasetOptions& options, const Warnings& warnings);

/// Splits by position alone, for images without times; kAuto means kEvery.
Split split_by_position(size_t count, const SplitRule& rule, const std::string& path);

}  // namespace jade::data
