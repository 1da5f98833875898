// SPDX-License-Identifier: Apache-2.0
// Files that contain only events.
#include "jade/core/error.h"
#include "jade/core/text.h"
#include "jade/events/event_files.h"
#include "jade/recording/contents.h"
#include "jade/recording/format.h"

namespace jade::recording {

namespace fs = std::filesystem;

void note_stored(int64_t events, const events::TimeWindow& span_us, int64_t most,
                 Recording& recording) {
  recording.stored_events = events;
  recording.stored_us = span_us;
  const int64_t left = events - recording.events.size();
  if (left == 0) return;
  if (most > 0 && recording.events.size() == most) {
    recording.notes.push_back(
        concat("of ", events, " events only the first ", most, " were looked at closely"));
    return;
  }
  recording.notes.push_back(concat(left, " of ", events,
                                   " events lie outside the time that is read, or far from every "
                                   "frame, and were left out"));
}

ReadEvents events_of(const fs::path& path, const ReadOptions& options,
                     const std::optional<events::TimeWindow>& exposures, Recording& recording) {
  if (in_small_letters(path.extension().string()) == ".raw")
    return events_of_evt(path, options, recording);
  return [=](const Wanted& wanted, Recording& out) {
    events::EventFileOptions how;
    how.time_unit = options.time_unit;
    how.exposures = exposures;
    how.frames = wanted.frames;
    how.keep = wanted.kept;
    how.most = options.most_events;
    how.event_bytes = options.event_bytes;
    how.group = options.events_group;
    events::EventFileResult result = events::read_events(path, how);
    out.events = std::move(result.events);
    if (result.sensor && out.width == 0)
      out.width = result.sensor->width, out.height = result.sensor->height;
    for (std::string& warning : result.warnings) out.warnings.push_back(std::move(warning));
    note_stored(result.stored, result.stored_us, options.most_events, out);
  };
}

Contents read_event_file(const fs::path& path, const ReadOptions& options) {
  Contents out;
  out.recording.format = concat("events in ", word_of(recognise(path)));
  out.read_events = events_of(path, options, std::nullopt, out.recording);
  if (recognise(path) == Format::kHdf5) add_hdf5_frames(path, options, out);
  return out;
}

}  // namespace jade::recording
