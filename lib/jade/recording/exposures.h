// SPDX-License-Identifier: Apache-2.0
// Exposure times of frames.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "jade/core/words.h"
#include "jade/events/event_stream.h"

namespace jade::recording {

/// Which instant of the exposure a single timestamp marks.
enum class Stamp { kStart, kMiddle, kEnd };

constexpr auto words_of(Stamp) {
  return std::array{Word{"start", Stamp::kStart, "start of the exposure"},
                    Word{"middle", Stamp::kMiddle, "middle of the exposure"},
                    Word{"end", Stamp::kEnd, "end of the exposure"}};
}

/// The exposure of `length_us` with the time stamp `t_us`.
events::TimeWindow exposure_at(int64_t t_us, int64_t length_us, Stamp stamp);

/// Edges on the event sensor's trigger input, both lists sorted by time.
struct Triggers {
  std::vector<int64_t> rising_us, falling_us;
};

/// The level of the trigger input while a frame is exposed.
enum class TriggerLevel { kHigh, kLow };

constexpr auto words_of(TriggerLevel) {
  return std::array{
      Word{"high", TriggerLevel::kHigh, "an exposure lasts from a rising edge to the falling one"},
      Word{"low", TriggerLevel::kLow, "from a falling edge to the rising one"}};
}

/// The exposures that trigger edges mark, sorted by time. Edges without a partner, at the ends of a
/// recording or after a lost edge, are ignored.
std::vector<events::TimeWindow> exposures_of(const Triggers& triggers, TriggerLevel level);

/// A line of an exposure list.
struct NamedExposure {
  std::string name;  ///< name of the image file, with or without its extension
  int64_t start_us = 0, end_us = 0;
};

/// Reads lines "name,start_us,end_us", whole µs by the clock of the events, separated by ',', ';'
/// or tab; "5000.0" counts as whole. Skips lines of '#'. The third column of a header line may be a
/// length (duration_us, exposure_us).
/// @throws DataError naming the line for other content, an end before its start, a duplicate name,
///   and naming the column of a header in another unit or order.
std::vector<NamedExposure> read_exposures(const std::filesystem::path& path);

/// Writes such a list with its header line. @throws DataError.
void write_exposures(const std::filesystem::path& path,
                     const std::vector<NamedExposure>& exposures);

}  // namespace jade::recording
