// SPDX-License-Identifier: Apache-2.0
// Finds the events of a data set, converts them to µs, cuts them and assigns them to exposures.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "jade/data/dataset.h"
#include "jade/data/warnings.h"

namespace jade::data {

/// Closed interval; the default has no bounds.
struct EventSpan {
  int64_t begin_us = INT64_MIN;
  int64_t end_us = INT64_MAX;
};

/// The recording that `options` names, or the first of events.h5, events.hdf5, events/events.h5,
/// events.npz, events.npy, events.txt, events.csv in its folder; empty if there is none.
std::filesystem::path find_event_file(const DatasetOptions& options);

/// Loads the recording into data.events, in the time unit that matches `exposures` (first start to
/// last end), drops events outside `keep`, and gives each exposure in data.train its slice. Warns
/// of events that lie outside the image or are not finite, of recordings with hardly any events of
/// one polarity or events in a part of the image only, and of exposures without events.
/// @throws DataError as load_dataset.
void attach_events(const DatasetOptions& options, const EventSpan& exposures, const EventSpan& keep,
                   const Warnings& warnings, Dataset& data);

/// Warns of a pixel with more events than a moving camera explains: a twentieth of all, or a
/// hundred times the 99.9th percentile.
void tell_hot_pixel(const Dataset& data, const Warnings& warnings);

}  // namespace jade::data
