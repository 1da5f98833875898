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
  /// kAuto: as guess_time_unit.
  TimeUnit time_unit = TimeUnit::kAuto;
  /// From the first exposure's start to the last exposure's end, in µs.
  std::optional<TimeWindow> exposures;
  /// If set, only events in these windows are kept; windows are sorted and disjoint, in µs. An HDF5
  /// file in order of time is read only there.
  std::optional<std::vector<TimeWindow>> keep = std::nullopt;
  /// Keeps at most the first `most` of those events, for an HDF5 file; 0: all.
  int64_t most = 0;
  /// Bytes that the caller will need per kept event; if all need more than 0.7 of the machine's
  /// memory, throws before reading. 0: no check.
  double event_bytes = 0;
  /// Without `exposures`: from the first frame to the last, in µs by a clock that may be another.
  std::optional<TimeWindow> frames = std::nullopt;
  /// For an HDF5 file: the group of the arrays, or the name of the records or the table. Empty: the
  /// stream nearest to the root, the first by name, with a warning that lists all.
  std::string group = "";
};

struct EventFileResult {
  EventStream events;
  TimeUnit time_unit = TimeUnit::kUs;  ///< as found in the file, never kAuto
  bool was_unsorted = false;           ///< times were not in order and have been sorted
  int64_t stored = 0;                  ///< events of the file without strays, kept or not
  TimeWindow stored_us;                ///< times of the first and last of these events, inclusive
  std::optional<ImageSize> sensor;     ///< its size, if in the file
  std::vector<std::string> warnings;   ///< one line each, naming the path
};

/// The events in sorted, disjoint windows: a view if they are contiguous (as events that
/// read_events kept are), else a copy.
EventStream only_in(const std::vector<TimeWindow>& windows, const EventStream& events);

/// The share of the machine's memory that a recording may use.
constexpr double kMostMemory = 0.7;

/// @param fix  what to do about it, for the message
/// @throws DataError if `what`, which needs that many bytes, exceeds kMostMemory of
///   machine_memory().
void check_memory(
    const std::string& what, double bytes,
    const std::string& fix = "choose a shorter span of time (jade_import: --begin-s, --end-s)");

/// Checks memory for `count` events of `bytes` bytes each.
void check_event_memory(const std::filesystem::path& path, int64_t count, double bytes);

/// Reads a recording into memory, 17 bytes per event without a second copy (16 bytes more per event
/// while unsorted times are sorted, and for .npz and text).
///   HDF5   in the file or in a group: 1-D data sets x, y, t, p of any integer or float type (a
///          t_offset beside them or in the file is added); records with fields of these names; a
///          table [N,4] or [4,N] that is called "event…" or is the only one
///   .npz   arrays of these names, or one array as in .npy
///   .npy   records with fields of these names, or a table [N,4] or [4,N]
///   text   .txt .csv .tsv: one line per event, separated by blanks, commas or semicolons; lines
///          of '#' or '%' are comments, and one line of column names, or of width and height, may
///          come first; also compressed, .txt.gz
/// Numbers in text may be quoted and have decimal commas between semicolons or tabs; ON, OFF, True
/// and False are polarities.
/// Other names of x, y, t, p are xs ys ts ps, time, timestamp(s), pol, polarity; t_us, t_ns, t_ms,
/// t_s and "t [us]" also give the unit, and so does an attribute "unit" or "units" in HDF5. Columns
/// without names are recognised by their values: polarities are 0/1 or -1/+1, times never decrease,
/// x comes before y.
/// A folder stands for its event_chunks().
/// Times are stored in µs, rounded down from ns. Unsorted times are sorted stably; copies
/// (without_copies()) and a few events far from all others are left out. Events with NaN
/// coordinates stay in the stream; counts ignore them. Each of these gives a warning.
/// @throws DataError naming the path: missing or damaged files, arrays that are missing or of
///   different lengths, ambiguous columns, a group that the file does not contain, other
///   polarities, times that are NaN or overlap no exposure in any unit.
EventFileResult read_events(const std::filesystem::path& path,
                            const EventFileOptions& options = {});

/// Numbered files of one stream in a folder, sorted by name: arrays, or text where there are none,
/// whose names differ only by a number at their end. Empty if there are none or only one, or others
/// of their kind, or if their names are those of cameras (cam, left, right, front, back).
std::vector<std::filesystem::path> event_chunks(const std::filesystem::path& folder);

/// The stream of an HDF5 file that read_events reads. @throws DataError as it does.
std::string event_group_name(const std::filesystem::path& path, const std::string& group);

/// Sorts events by time, stably.
/// @param x,y,t_us,polarity  as in EventStream, in any order.
EventStream sort_events(const torch::Tensor& x, const torch::Tensor& y, const torch::Tensor& t_us,
                        const torch::Tensor& polarity);

}  // namespace jade::events
