// SPDX-License-Identifier: Apache-2.0
// Folders with frames, their times and a file of events, such as the EvDeblur layout without poses
// or what scripts/read_recording.py makes: that has recording.txt and triggers.csv besides.
#pragma once

#include <filesystem>

namespace jade::recording {

/// True where a folder holds events.h5 (or .hdf5, .npz, .npy, .csv, .raw), or images_1/ or images/
/// with timestamps.npz or exposures.csv.
bool is_event_folder(const std::filesystem::path& folder);

/// True where a file of a ROS 2 bag (.db3, .mcap) lies in the folder.
bool holds_bag(const std::filesystem::path& folder);

}  // namespace jade::recording
