// SPDX-License-Identifier: Apache-2.0
// What the readers of each format give event_files.cpp. Not for use outside this folder.
#pragma once

#include <filesystem>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/events/time_survey.h"

namespace jade::events {

/// A recording as stored: coordinates and polarities in our types, times in the file's unit.
struct RawEvents {
  torch::Tensor x, y;      ///< float32 [N]
  torch::Tensor polarity;  ///< int8 [N], as stored
  torch::Tensor time;      ///< int64, or float64 where the file has floats, [N]
};

RawEvents read_hdf5_events(const std::filesystem::path& path);
/// The times of such a file without the rest.
TimeSurvey survey_hdf5_times(const std::filesystem::path& path);
/// Events of these stretches alone, which lie in order and apart.
RawEvents read_hdf5_events(const std::filesystem::path& path,
                           const std::vector<Stretch>& stretches);
RawEvents read_npz_events(const std::filesystem::path& path);
RawEvents read_npy_events(const std::filesystem::path& path);
RawEvents read_text_events(const std::filesystem::path& path);

/// Which of x, y, t, p (0 to 3) an array of this name holds, or -1. Names without their group.
int event_field(const std::string& name);

}  // namespace jade::events
