// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "jade/simulate/camera_path.h"
#include "jade/simulate/options.h"

namespace jade::simulate {

/// The times of a recording, µs. All exposures have the same length and a constant period, until
/// shorten() of auto_exposure.h changes them.
struct Timeline {
  struct Window {
    int64_t begin_us, end_us;
    int64_t mid_us() const { return begin_us + (end_us - begin_us) / 2; }
  };
  int64_t end_us = 0;  ///< the recording is [0, end_us]
  std::vector<Window> exposures;
  std::vector<int64_t> tests_us;  ///< of the sharp test views: first the seen ones, then those in
                                  ///< gaps
};
Timeline make_timeline(const SimulateOptions& options);

/// Sets the path's speed so that the mean blur over the timeline's exposures is `blur_px`.
/// @return the resulting mean blur, px
double set_speed_for_blur(CameraPath& path, const world::FrameSource& source,
                          const geometry::Intrinsics& camera, const Timeline& timeline,
                          double blur_px);

/// The latest time of the next frame at which no pixel of `frame` (rendered at `now_us`) has moved
/// more than max_flow_px, subject to min_fps and `until_us`.
class FrameClock {
 public:
  FrameClock(const SamplingOptions& options, const CameraPath& path,
             const geometry::Intrinsics& camera);
  int64_t next_us(const world::SharpFrame& frame, int64_t now_us, int64_t until_us);

 private:
  const SamplingOptions options_;
  const CameraPath& path_;
  const geometry::Intrinsics camera_;
  double step_us_ = 1000;
};

}  // namespace jade::simulate
