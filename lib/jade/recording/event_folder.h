// SPDX-License-Identifier: Apache-2.0
// Folders with frames, their times and a file of events, such as the EvDeblur layout without poses
// or the output of scripts/read_recording.py, which also has recording.txt and triggers.csv.
#pragma once

#include <filesystem>

namespace jade::recording {

/// True if a folder contains events.h5 (or .hdf5, .npz, .npy, .csv, .raw), or images_1/ or images/
/// with timestamps.npz or exposures.csv.
bool is_event_folder(const std::filesystem::path& folder);

/// True if the folder contains a file of a ROS 2 bag (.db3, .mcap).
bool holds_bag(const std::filesystem::path& folder);

}  // namespace jade::recording
