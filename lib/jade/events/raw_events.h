// SPDX-License-Identifier: Apache-2.0
// Results of the format readers for event_files.cpp. Private to this folder.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/events/columns.h"
#include "jade/events/event_stream.h"
#include "jade/events/time_survey.h"
#include "jade/events/time_unit.h"

namespace jade::events {

/// A recording as stored: coordinates and polarities in this library's types, times in the file's
/// unit.
struct RawEvents {
  torch::Tensor x, y;               ///< float32 [N]
  torch::Tensor polarity;           ///< int8 [N], as stored
  torch::Tensor time;               ///< int64 or, if the file has floats, float64; [N]
  TimeUnit unit = TimeUnit::kAuto;  ///< of the times, if their name contains it
  std::optional<ImageSize> size;    ///< of the sensor, if the file contains it
  int time_bits = 64;               ///< significant_bits() of the times as stored
  std::string note;                 ///< warning of a file that was read in doubt, or empty
  std::optional<Columns> columns;   ///< of a table of four columns
};

/// One stream of events in an HDF5 file: arrays in a group, records, or a table of four columns.
class Hdf5Events {
 public:
  /// @param group  of the arrays, or the name of the records or the table; empty: the stream
  ///   nearest to the root, the first by name
  /// @param known  columns of a table; none: by their values
  /// @throws DataError for a file without events, or without this stream, listing its streams.
  Hdf5Events(const std::filesystem::path& path, const std::string& group,
             const std::optional<Columns>& known = std::nullopt);
  ~Hdf5Events();

  const std::string& name() const;
  /// Notes for the user: other streams, and data beside the events that are not used.
  const std::vector<std::string>& notes() const { return notes_; }
  TimeUnit unit() const;
  /// significant_bits() of the times as stored.
  int time_bits() const;
  int64_t length() const;
  /// Surveys the times without reading the other fields.
  TimeSurvey survey() const;
  /// Reads all events, or only those of these sorted, disjoint stretches.
  RawEvents read(const std::optional<std::vector<Stretch>>& stretches = std::nullopt) const;

 private:
  struct Source;
  std::vector<std::string> notes_;
  std::shared_ptr<const Source> source_;
};

enum class EventFileKind { kHdf5, kNpz, kNpy, kText };

/// Recognised by its first bytes, because data sets use several extensions for one format; text by
/// its extension. @throws DataError for other files.
EventFileKind file_kind(const std::filesystem::path& path);

/// Reads a file that is not HDF5.
/// @param group  that the user chose, for which only HDF5 has a use
/// @param known  columns of a table without names; none: by their values
/// @throws DataError if a group was chosen.
RawEvents read_raw(const std::filesystem::path& path, EventFileKind kind, const std::string& group,
                   const std::optional<Columns>& known = std::nullopt);

/// Reads the files of event_chunks() as one, in the order of their first times, and adds how many
/// there are to `warnings`. The columns of tables without names are those of the largest file.
/// @param event_bytes  as in EventFileOptions
/// @throws DataError for files that overlap in time or have times in different units.
RawEvents read_chunks(const std::filesystem::path& folder, const std::string& group,
                      double event_bytes, std::vector<std::string>& warnings);

RawEvents read_npz_events(const std::filesystem::path& path, const std::optional<Columns>& known);
RawEvents read_npy_events(const std::filesystem::path& path, const std::optional<Columns>& known);
RawEvents read_text_events(const std::filesystem::path& path, const std::optional<Columns>& known);

/// Converts polarities to int8. @throws DataError for fractions, which the conversion would
/// truncate.
torch::Tensor whole_polarity(const std::filesystem::path& path, const torch::Tensor& polarity);

/// @throws DataError unless x, y, t and p have the same length.
void check_lengths(const std::filesystem::path& path, const std::array<int64_t, 4>& lengths);

}  // namespace jade::events
