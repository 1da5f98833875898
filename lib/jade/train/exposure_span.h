// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/geometry/trajectory.h"

namespace jade::train {

/// A time span and the camera path in it.
struct ExposureSpan {
  int64_t begin_us = 0, end_us = 0;
  geometry::Trajectory path;

  /// camera_from_world at moment u, 0 at the start and 1 at the end.
  geometry::Pose at(double u) const {
    return path.at(static_cast<double>(begin_us) + u * static_cast<double>(end_us - begin_us));
  }
};

/// The exposure with the path through its nine poses.
ExposureSpan span_of(const data::Exposure& exposure);

/// All training exposures, with the data set's own path if it covers them, else through their nine
/// poses.
std::vector<ExposureSpan> exposure_spans(const data::Dataset& dataset);

}  // namespace jade::train
