// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "jade/core/words.h"
#include "jade/events/event_stream.h"

namespace jade::events {

/// Of time stamps.
enum class TimeUnit { kAuto, kUs, kNs, kS };

constexpr auto words_of(TimeUnit) {
  return std::array{Word{"auto", TimeUnit::kAuto}, Word{"us", TimeUnit::kUs},
                    Word{"ns", TimeUnit::kNs}, Word{"s", TimeUnit::kS}};
}

struct EventFileOptions {
  /// kAuto: the unit in which the recording overlaps `exposures` best. Without `exposures`, kAuto
  /// takes µs for whole numbers and seconds for numbers with a fraction.
  TimeUnit time_unit = TimeUnit::kAuto;
  /// From the first exposure's start to the last one's end, in µs.
  std::optional<TimeWindow> exposures;
  /// When given, events beside the image are counted and reported.
  std::optional<ImageSize> size;
};

struct EventFileResult {
  EventStream events;
  TimeUnit time_unit = TimeUnit::kUs;  ///< as found in the file, never kAuto
  EventProblems problems;              ///< outside and touching_edge only when a size was given
  bool was_unsorted = false;           ///< times were not in order and have been sorted
  std::vector<std::string> warnings;   ///< one line each, naming the path
};

/// Reads a recording into memory, 17 bytes per event and no second copy of it (16 bytes more for
/// each event while unsorted times are being sorted, and for .npz and text).
///   .h5 .hdf5   1-D data sets x, y, t, p of any integer or float type, in the file or in a group
///               ("events/x", as DSEC; its t_offset is added); also xs ys ts ps, timestamps,
///               polarity
///   .npz        arrays of these names
///   .npy        [N,4], columns t x y p or x y t p: of the first and the third, the larger is time
///   .txt .csv   a line "t x y p" an event, blanks or commas; lines of '#' and one header line
///               are skipped
/// Polarity is 0/1 or −1/+1. Times are stored in µs, rounded down from ns. Unsorted times are
/// sorted, keeping the order of equal ones, with a warning; duplicates are kept; events with NaN
/// coordinates or beside the image stay in the stream, where nothing counts them, with a warning.
/// @throws DataError naming the path: missing or damaged files, arrays that are missing or of
///   different lengths, other polarities, times that are NaN or meet no exposure in any unit.
EventFileResult read_events(const std::filesystem::path& path,
                            const EventFileOptions& options = {});

/// The unit that read_events would take for times from `first` to `last` as stored in a file.
/// None when the recording meets the exposures in no unit.
std::optional<TimeUnit> guess_time_unit(double first, double last, bool has_fraction,
                                        const std::optional<TimeWindow>& exposures);

/// The same events in order of time; the order of equal times is kept.
/// @param x,y,t_us,polarity  as EventStream takes them, in any order.
EventStream sort_events(const torch::Tensor& x, const torch::Tensor& y, const torch::Tensor& t_us,
                        const torch::Tensor& polarity);

}  // namespace jade::events
