// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "jade/simulate/camera_path.h"
#include "jade/simulate/options.h"

namespace jade::simulate {

/// The times of a recording, µs. All exposures are equally long and follow each other at equal
/// steps, until shorten() of auto_exposure.h.
struct Timeline {
  struct Window {
    int64_t begin_us, end_us;
    int64_t mid_us() const { return begin_us + (end_us - begin_us) / 2; }
  };
  int64_t end_us = 0;  ///< the recording is [0, end_us]
  std::vector<Window> exposures;
  std::vector<int64_t> tests_us;  ///< of the sharp test views: first the seen, then those in gaps
};
Timeline make_timeline(const SimulateOptions& options);

/// Sets the path's speed so that the mean blur over the timeline's exposures is `blur_px`.
/// @return the mean blur reached, px
double set_speed_for_blur(CameraPath& path, const world::FrameSource& source,
                          const geometry::Intrinsics& camera, const Timeline& timeline,
                          double blur_px);

/// When to render the next frame: as late as possible, such that no pixel of `frame` (rendered at
/// `now_us`) moves further than max_flow_px, min_fps is kept, and `until_us` is not passed.
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
