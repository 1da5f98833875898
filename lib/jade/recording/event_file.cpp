// SPDX-License-Identifier: Apache-2.0
// Files that hold events alone.
#include <cmath>
#include <unistd.h>

#include "jade/core/error.h"
#include "jade/recording/contents.h"
#include "jade/recording/format.h"

namespace jade::recording {

namespace fs = std::filesystem;

double memory_bytes() { return double(sysconf(_SC_PHYS_PAGES)) * double(sysconf(_SC_PAGE_SIZE)); }

void check_event_memory(const fs::path& path, int64_t count) {
  constexpr double kBytes = 17;
  const double needed = kBytes * double(count);
  if (needed < 0.7 * memory_bytes()) return;
  throw DataError(concat(path.string(), ": ", count, " events need ", std::llround(1e-9 * needed),
                         " GB, and this machine has ", std::llround(1e-9 * memory_bytes()),
                         "; choose a shorter span of time"));
}

void add_events(const fs::path& path, const ReadOptions& options,
                const std::optional<events::TimeWindow>& exposures, Recording& recording) {
  if (path.extension() == ".raw") {
    Recording raw = read_evt(path, options).recording;
    recording.events = raw.events;
    recording.triggers = std::move(raw.triggers);
    recording.width = raw.width, recording.height = raw.height;
    recording.notes.insert(recording.notes.end(), raw.notes.begin(), raw.notes.end());
    return;
  }
  events::EventFileOptions file_options;
  file_options.time_unit = options.time_unit;
  file_options.exposures = exposures;
  events::EventFileResult result = events::read_events(path, file_options);
  recording.events = std::move(result.events);
  for (std::string& warning : result.warnings) recording.notes.push_back(std::move(warning));
}

Contents read_event_file(const fs::path& path, const ReadOptions& options) {
  Contents out;
  out.recording.format = concat("events in ", word_of(recognise(path)));
  add_events(path, options, std::nullopt, out.recording);
  return out;
}

}  // namespace jade::recording
