// SPDX-License-Identifier: Apache-2.0
// Folders with frames, their times and a file of events: the text layout of RPG Zurich, DSEC,
// TUM-VIE, the EvDeblur layout without poses, or the output of scripts/read_recording.py, which
// also has recording.txt and triggers.csv.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace jade::recording {

/// True if a folder has events (a file of a usual name, or the only one with "events" in its name
/// or in events/, or numbered files there), or images_1/ or images/ with timestamps.npz or
/// exposures.csv.
bool is_event_folder(const std::filesystem::path& folder);

/// Files that may have the events of a folder without one of a usual name: arrays, text, and those
/// of cameras, sorted.
std::vector<std::string> unfound_events(const std::filesystem::path& folder);

/// For each compressed file of a folder that no reader unpacks: its name, and the command that does
/// ("events.txt.xz, a file that xz compressed; …"), sorted.
std::vector<std::string> packed_files(const std::filesystem::path& folder);

/// True if the folder contains a file of a ROS 2 bag (.db3, .mcap).
bool holds_bag(const std::filesystem::path& folder);

}  // namespace jade::recording
