// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "jade/events/event_stream.h"
#include "jade/events/time_unit.h"

namespace jade::events {

struct EventFileOptions {
  /// kAuto: as guess_time_unit has it.
  TimeUnit time_unit = TimeUnit::kAuto;
  /// From the first exposure's start to the last one's end, in µs.
  std::optional<TimeWindow> exposures;
  /// When given, events beside the image are counted and reported.
  std::optional<ImageSize> size;
  /// When given, only events in these are kept; they lie in order and apart, in µs. Of an HDF5 file
  /// in order of time nothing else is read into memory.
  std::optional<std::vector<TimeWindow>> keep = std::nullopt;
  /// No more than the first so many of those are kept, of an HDF5 file; 0: all.
  int64_t most = 0;
  /// Bytes that a kept event may come to cost the caller; more of them than 0.7 of the machine's
  /// memory are refused before they are read. 0: not checked.
  double event_bytes = 0;
};

struct EventFileResult {
  EventStream events;
  TimeUnit time_unit = TimeUnit::kUs;  ///< as found in the file, never kAuto
  EventProblems problems;              ///< outside and touching_edge only when a size was given
  bool was_unsorted = false;           ///< times were not in order and have been sorted
  int64_t stored = 0;                  ///< events of the file, kept or not
  TimeWindow stored_us;                ///< from the first of these to the last, both within
  std::vector<std::string> warnings;   ///< one line each, naming the path
};

/// The events in windows that lie in order and apart: a view where they are in one piece, as those
/// that read_events has kept are, else a copy.
EventStream only_in(const std::vector<TimeWindow>& windows, const EventStream& events);

/// The share of a machine's memory that a recording may take.
constexpr double kMostMemory = 0.7;

/// @param fix  what to do about it, for the message
/// @throws DataError if `what`, which takes so many bytes, does not fit into kMostMemory of what
///   machine_memory() says.
void check_memory(
    const std::string& what, double bytes,
    const std::string& fix = "choose a shorter span of time (jade_import: --begin-s, --end-s)");

/// Checks memory for `count` events of `bytes` bytes each.
void check_event_memory(const std::filesystem::path& path, int64_t count, double bytes);

/// Reads a recording into memory, 17 bytes per event and no second copy of it (16 bytes more for
/// each event while unsorted times are being sorted, and for .npz and text).
///   .h5 .hdf5   1-D data sets x, y, t, p of any integer or float type, in the file or in a group
///               ("events/x", as DSEC; its t_offset is added); also xs ys ts ps, timestamps,
///               polarity
///   .npz        arrays of these names
///   .npy        [N,4], columns t x y p or x y t p: of the first and the third, the one that never
///               decreases is time; where both or neither do, the larger
///   .txt .csv   a line "t x y p" an event, blanks or commas; lines of '#' and one header line
///               are skipped
/// Polarity is 0/1 or −1/+1. Times are stored in µs, rounded down from ns. Unsorted times are
/// sorted, keeping the order of equal ones, with a warning; duplicates are kept; events with NaN
/// coordinates or beside the image stay in the stream, where nothing counts them, with a warning.
/// @throws DataError naming the path: missing or damaged files, arrays that are missing or of
///   different lengths, other polarities, times that are NaN or meet no exposure in any unit.
EventFileResult read_events(const std::filesystem::path& path,
                            const EventFileOptions& options = {});

/// Sorts events by time; the order of equal times is kept.
/// @param x,y,t_us,polarity  as EventStream takes them, in any order.
EventStream sort_events(const torch::Tensor& x, const torch::Tensor& y, const torch::Tensor& t_us,
                        const torch::Tensor& polarity);

}  // namespace jade::events
