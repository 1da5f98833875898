// SPDX-License-Identifier: Apache-2.0
// The events of a data set: found, brought to µs, cut and handed to the exposures.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "jade/data/dataset.h"
#include "jade/data/warnings.h"

namespace jade::data {

/// Both ends included; the default is all of time.
struct EventSpan {
  int64_t begin_us = INT64_MIN;
  int64_t end_us = INT64_MAX;
};

/// The recording that `options` names, or the first of events.h5, events.hdf5, events/events.h5,
/// events.npz, events.npy, events.txt, events.csv in its folder; empty if there is none.
std::filesystem::path find_event_file(const DatasetOptions& options);

/// Loads the recording into data.events, in the unit of time that `exposures` (first start to last
/// end) call for, drops events outside `keep`, and gives each exposure in data.train its slice.
/// Warns of events that lie outside the image, are not finite or hardly any of one polarity, and of
/// exposures without events.
/// @throws DataError as load_dataset.
void attach_events(const DatasetOptions& options, const EventSpan& exposures, const EventSpan& keep,
                   const Warnings& warnings, Dataset& data);

/// Warns of a pixel with more of the events than a moving camera explains: a twentieth of all, or a
/// hundred times what one pixel in a thousand has.
void tell_hot_pixel(const Dataset& data, const Warnings& warnings);

}  // namespace jade::data
