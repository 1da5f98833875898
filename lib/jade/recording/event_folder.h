// SPDX-License-Identifier: Apache-2.0
// Folders with frames, their times and a file of events, such as the EvDeblur layout without poses
// or the output of scripts/read_recording.py, which also has recording.txt and triggers.csv.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace jade::recording {

struct Recording;

/// True if a folder contains events.h5 (or .hdf5, .npz, .npy, .csv, .raw; events/left/events.h5 of
/// DSEC, SEQUENCE-events_left.h5 of TUM-VIE), or images_1/ or images/ with timestamps.npz or
/// exposures.csv.
bool is_event_folder(const std::filesystem::path& folder);

/// events.txt or events.txt.gz of a folder; empty if there is none.
std::filesystem::path text_events_in(const std::filesystem::path& folder);

/// Warns of files of events in a folder beside the one that is read.
void warn_of_other_events(const std::filesystem::path& folder, const std::filesystem::path& read,
                          Recording& recording);

/// For each compressed file of a folder that no reader unpacks: its name, and the command that does
/// ("events.txt.xz, a file that xz compressed; …"), sorted.
std::vector<std::string> packed_files(const std::filesystem::path& folder);

/// True if the folder contains a file of a ROS 2 bag (.db3, .mcap).
bool holds_bag(const std::filesystem::path& folder);

}  // namespace jade::recording
