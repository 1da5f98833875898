// SPDX-License-Identifier: Apache-2.0
// Which frames a run trained on, to recognise them in a data set whose split has changed since.
#pragma once

#include <string>
#include <vector>

#include "jade/data/exposure.h"

namespace jade::data {

struct TrainedFrame {
  std::string name;
  std::string sha256;  ///< of the pixels, as loaded
};

/// The training exposures of the data set.
std::vector<TrainedFrame> trained_frames(const Dataset& dataset);

/// The test views of the data set; the hash also covers the pose.
std::vector<TrainedFrame> test_views(const Dataset& dataset);

/// Sets SharpView::seen for a scene that was trained on these frames instead of dataset.train; not
/// if the data set has none of them.
/// @return a warning if test views or held-out exposures are among them, or training exposures are
///   not, or it has none; else empty
std::string mark_seen(const std::vector<TrainedFrame>& trained, Dataset& dataset);

}  // namespace jade::data
