// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

#include "jade/geometry/camera.h"
#include "jade/geometry/pose.h"
#include "jade/world/frame_source.h"
#include "jade/world/world.h"

namespace jade::simulate {

/// A handheld camera: the eye, the target point and the roll each follow a smooth sum of three
/// sinusoids (a slow sweep over the viewpoints, a sway and a tremor).
class CameraPath {
 public:
  /// @param reach  multiplies the rig's amplitudes
  CameraPath(const world::CameraRig& rig, double reach, uint64_t seed);

  /// Sweeps per second of the slow component; default 1.
  void set_speed(double speed) { speed_ = speed; }
  double speed() const { return speed_; }

  /// The camera rests for the first `part` of each period and catches up in the remaining time.
  void set_rest(double part, double period_us) { rest_ = part, rest_period_us_ = period_us; }

  /// camera_from_world at any time.
  geometry::Pose at(double t_us) const;

 private:
  struct Wander {
    std::array<double, 3> amplitude, frequency, phase;
    double at(double t) const;
  };
  std::array<double, 3> eye_, target_, up_;
  std::array<Wander, 7> wander_;  // eye xyz, target xyz, roll
  double moved_until(double t_us) const;
  double speed_ = 1;
  double rest_ = 0, rest_period_us_ = 1;
};

/// Mean over pixels of the length of their image path while the camera moves from `begin_us` to
/// `end_us`, px. `mid` is a frame (any resolution) at the middle with `camera`.
double blur_length(const CameraPath& path, const geometry::Intrinsics& camera,
                   const world::SharpFrame& mid, double begin_us, double end_us);

/// Largest distance that a pixel of `frame` (taken at `from`) moves until `to`.
double largest_flow(const world::SharpFrame& frame, const geometry::Intrinsics& camera,
                    const geometry::Pose& from, const geometry::Pose& to);

/// Mean squared distance, over all pixels of `frame` (taken at `from`), between the projections of
/// its points by cameras at `a` and at `b`, px².
double mean_square_distance(const world::SharpFrame& frame, const geometry::Intrinsics& camera,
                            const geometry::Pose& from, const geometry::Pose& a,
                            const geometry::Pose& b);

}  // namespace jade::simulate
