// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/written_poses.h"

#include <algorithm>
#include <cmath>

#include "jade/core/interrupt.h"
#include "jade/core/random.h"

namespace jade::simulate {
namespace {

/// The times, increasing, of the poses of the exposures that a reconstruction estimates.
std::vector<int64_t> estimated_times(const Timeline& timeline, PoseTimes at) {
  std::vector<int64_t> times;
  for (const auto& window : timeline.exposures) {
    const int64_t length = window.end_us - window.begin_us;
    if (at == PoseTimes::kMidExposure) {
      times.push_back(window.mid_us());
    } else if (at == PoseTimes::kThirds) {
      for (const int64_t t :
           {window.begin_us + length / 6, window.mid_us(), window.end_us - length / 6})
        times.push_back(t);
    } else {
      for (const double t : geometry::exposure_times(window.begin_us, window.end_us))
        times.push_back(std::llround(t));
    }
  }
  return times;
}

std::vector<int64_t> with_tests(std::vector<int64_t> times, const Timeline& timeline) {
  times.insert(times.end(), timeline.tests_us.begin(), timeline.tests_us.end());
  return times;
}

void add(double squares, PoseErrorPx& error) {
  error.rms += squares;
  error.max = std::max(error.max, std::sqrt(squares));
}

}  // namespace

WrittenPoses::WrittenPoses(const SimulateRun& run, const Footage& footage, const Timeline& timeline)
    : options_(run.simulate.poses),
      footage_(footage),
      error_(options_.correlation_ms * 1000,
             with_tests(estimated_times(timeline, options_.at), timeline),
             derive_seed(static_cast<uint64_t>(run.seed), "pose noise")) {
  if (options_.at == PoseTimes::kPath) return;
  std::vector<double> times;
  std::vector<geometry::Pose> poses;
  for (const int64_t t : estimated_times(timeline, options_.at)) {
    times.push_back(static_cast<double>(t));
    poses.push_back(frame(t));
  }
  through_exposures_ =
      geometry::Trajectory(times, poses).spanning(0, static_cast<double>(timeline.end_us));
}

geometry::Pose WrittenPoses::path(int64_t t_us) const {
  return through_exposures_.empty() ? frame(t_us)
                                    : through_exposures_.at(static_cast<double>(t_us));
}

geometry::Pose WrittenPoses::frame(int64_t t_us) const {
  const geometry::Pose pose = footage_.pose(static_cast<double>(t_us));
  if (options_.rotation_deg == 0 && options_.position == 0) return pose;
  const auto e = error_.at(t_us);
  const double angle = options_.rotation_deg * 3.141592653589793 / 180;
  const geometry::Pose turn{
      geometry::rotation_from_vector({e[0] * angle, e[1] * angle, e[2] * angle}), {0, 0, 0}};
  auto centre = geometry::centre(pose);
  for (size_t i = 0; i < 3; ++i) centre[i] += options_.position * e[i + 3];
  return geometry::pose_at_centre(geometry::compose(turn, pose).rotation, centre);
}

PoseErrors pose_errors(const std::vector<data::Exposure>& exposures, const Footage& footage) {
  PoseErrors errors;
  world::SharpFrame mid;
  for (const data::Exposure& exposure : exposures) {
    throw_if_interrupted();
    footage.frame(exposure.t_mid_us(), /*samples=*/1, mid);
    const geometry::Pose from = footage.pose(static_cast<double>(exposure.t_mid_us()));
    const auto times = geometry::exposure_times(exposure.t_start_us, exposure.t_end_us);
    for (size_t k = 0; k < times.size(); ++k) {
      const auto squares = mean_square_distance(mid, footage.camera(), from, footage.pose(times[k]),
                                                exposure.poses[k]);
      add(squares, errors.nine);
      if (k == geometry::kMidPose) add(squares, errors.mid);
    }
  }
  const auto count = static_cast<double>(exposures.size());
  errors.mid.rms = std::sqrt(errors.mid.rms / count);
  errors.nine.rms = std::sqrt(errors.nine.rms / (count * geometry::kExposurePoses));
  return errors;
}

}  // namespace jade::simulate
