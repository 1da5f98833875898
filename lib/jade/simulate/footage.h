// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <torch/types.h>
#include <vector>

#include "jade/geometry/trajectory.h"
#include "jade/simulate/camera_path.h"
#include "jade/simulate/sampling.h"

namespace jade::simulate {

/// A separate camera for events.
struct EventCamera {
  geometry::Intrinsics camera;
  geometry::Pose from_frames;  ///< x_events = R x_frames + t
};

/// The scene in front of the sensors, which can be sampled at any time.
class Footage {
 public:
  virtual ~Footage() = default;
  virtual const geometry::Intrinsics& camera() const = 0;
  /// camera_from_world.
  virtual geometry::Pose pose(double t_us) const = 0;
  /// @param samples  rays per pixel, for ray-cast footage
  virtual void frame(int64_t t_us, int samples, world::SharpFrame& frame) const = 0;
  /// The event camera, if it differs from that of the frames.
  virtual std::optional<EventCamera> event_camera() const { return std::nullopt; }
  /// frame() as seen by event_camera(); only for footage that has one.
  virtual void event_frame(int64_t t_us, int samples, world::SharpFrame& frame) const;
  /// The time of the next frame after `frame`, which was taken at `now_us`: in (now_us, until_us].
  virtual int64_t next_us(const world::SharpFrame& frame, int64_t now_us, int64_t until_us) = 0;
  /// Depth range of nearly all points over the timeline's exposures.
  struct Depths {
    double near, far;
  };
  virtual Depths depths(const Timeline& timeline) const = 0;
  /// Mean blur over the exposures, and the largest motion of a pixel between two frames, px; 0 if
  /// unknown.
  virtual double blur_px() const { return 0; }
  virtual double largest_flow_px() const { return 0; }
};

/// Footage rendered along a camera path.
class RenderedFootage : public Footage {
 public:
  RenderedFootage(const SimulateRun& run, std::unique_ptr<world::FrameSource> source,
                  const world::CameraRig& rig, const Timeline& timeline);
  const geometry::Intrinsics& camera() const override { return camera_; }
  geometry::Pose pose(double t_us) const override { return path_.at(t_us); }
  void frame(int64_t t_us, int samples, world::SharpFrame& frame) const override;
  std::optional<EventCamera> event_camera() const override { return event_camera_; }
  void event_frame(int64_t t_us, int samples, world::SharpFrame& frame) const override;
  int64_t next_us(const world::SharpFrame& frame, int64_t now_us, int64_t until_us) override;
  Depths depths(const Timeline& timeline) const override;
  double blur_px() const override { return blur_px_; }
  double largest_flow_px() const override { return largest_flow_px_; }

 private:
  std::unique_ptr<world::FrameSource> source_;
  geometry::Intrinsics camera_;
  std::optional<EventCamera> event_camera_;
  CameraPath path_;
  FrameClock clock_;
  double blur_px_ = 0, largest_flow_px_ = 0;
};

/// Sharp frames with poses, evenly spaced in time; log values between them are interpolated
/// linearly, poses as in Trajectory.
class StoredFootage : public Footage {
 public:
  /// @param path  a folder with transforms.json; frames are sorted by name, frame_2 before frame_10
  /// @param log_eps  added before the logarithm
  /// @throws DataError for fewer than two frames, cameras that differ, or an unreadable folder.
  StoredFootage(const std::filesystem::path& path, double frames_per_second, double log_eps);
  const geometry::Intrinsics& camera() const override { return camera_; }
  geometry::Pose pose(double t_us) const override { return trajectory_.at(t_us); }
  void frame(int64_t t_us, int samples, world::SharpFrame& frame) const override;
  int64_t next_us(const world::SharpFrame& frame, int64_t now_us, int64_t until_us) override;
  Depths depths(const Timeline& timeline) const override;
  int64_t duration_us() const { return times_us_.back(); }

 private:
  std::vector<torch::Tensor> frames_;  // [3,H,W]
  std::vector<int64_t> times_us_;
  geometry::Intrinsics camera_;
  geometry::Trajectory trajectory_;
  double log_eps_;
  Depths depths_{};
};

}  // namespace jade::simulate
