// SPDX-License-Identifier: Apache-2.0
// Event files that contain more than one stream of events.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "jade/events/event_files.h"

namespace jade::events {

struct EventGroupResult {
  EventFileResult file;
  std::optional<ImageSize> sensor;  ///< size of the sensor, if the file contains it
};

/// Reads events like read_events, from one of several streams.
/// Supported formats:
///   HDF5   in the file or in a group: 1-D data sets x, y, t, p of any integer or float type (a
///          t_offset beside them or in the file is added); records with fields of these names; a
///          table [N,4] or [4,N] that is called "event…" or is the only one
///   .npz   arrays of these names, or one array as in .npy
///   .npy   records with fields of these names, or a table [N,4] or [4,N]
///   text   .txt .csv .tsv: one line per event, separated by blanks, commas or semicolons; lines
///          of '#' or '%' are comments, and one line of column names, or of width and height, may
///          come first
/// Numbers in text may be quoted and have decimal commas between semicolons or tabs; ON, OFF, True
/// and False are polarities.
/// Other names of x, y, t, p are xs ys ts ps, time, timestamp(s), pol, polarity; t_us, t_ns, t_ms,
/// t_s and "t [us]" also give the unit, and so does an attribute "unit" or "units" in HDF5. Columns
/// without names are recognised by their values: polarities are 0/1 or -1/+1, times never decrease,
/// x comes before y.
/// @param group  for an HDF5 file: the group of the arrays, or the name of the records or the
///   table. Empty: the stream nearest to the root, the first by name, with a warning that lists all
/// @throws DataError as read_events, for ambiguous columns, and for a group that the file does not
///   contain.
EventGroupResult read_event_group(const std::filesystem::path& path,
                                  const EventFileOptions& options = {},
                                  const std::string& group = "");

/// The stream of an HDF5 file that read_event_group reads. @throws DataError as it does.
std::string event_group_name(const std::filesystem::path& path, const std::string& group);

}  // namespace jade::events
