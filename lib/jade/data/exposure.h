// SPDX-License-Identifier: Apache-2.0
// The in-memory form of a data set, the same for all sources.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/core/words.h"
#include "jade/events/event_stream.h"
#include "jade/geometry/camera.h"
#include "jade/geometry/pose.h"
#include "jade/geometry/trajectory.h"

namespace jade::data {

/// The layout of a data set's folder; kAuto means that the loader recognises it.
enum class DatasetKind { kAuto, kEvDeblur, kDietGs, kColmap, kTransforms };

constexpr auto words_of(DatasetKind) {
  return std::array{Word{"auto", DatasetKind::kAuto}, Word{"evdeblur", DatasetKind::kEvDeblur},
                    Word{"diet_gs", DatasetKind::kDietGs}, Word{"colmap", DatasetKind::kColmap},
                    Word{"transforms", DatasetKind::kTransforms}};
}

/// One training item: a frame that integrated light over [t_start_us, t_end_us) while the camera
/// moved through nine poses at equal time steps, the fifth at mid-exposure.
/// A sharp training image (plain_3dgs) is an exposure of zero duration: nine equal poses, no
/// events.
struct Exposure {
  std::string name;      ///< image file name without extension
  torch::Tensor blurry;  ///< [3,H,W] RGB float32 in [0,1], CPU
  int64_t t_start_us = 0, t_end_us = 0;
  events::EventStream events;  ///< events of [t_start_us, t_end_us), a view of Dataset::events
  std::array<geometry::Pose, geometry::kExposurePoses> poses;  ///< camera_from_world
  geometry::Intrinsics camera;
  torch::Tensor mask;  ///< [1,H,W] bool, true: the pixel counts; undefined: all pixels count
  double gain = 1;     ///< frame brightness = scene brightness · gain
  bool stray = false;  ///< far from all other views: does not count for the size of the scene

  int64_t duration_us() const { return t_end_us - t_start_us; }
  int64_t t_mid_us() const { return t_start_us + duration_us() / 2; }
};

/// A sharp image for evaluation; training never sees it.
struct SharpView {
  std::string name;
  torch::Tensor image;  ///< [3,H,W] RGB float32 in [0,1], CPU
  geometry::Pose pose;  ///< camera_from_world
  geometry::Intrinsics camera;
  int64_t t_us = kNoTime;  ///< time of the image; kNoTime if the data set does not contain it
  /// Whether training sees the scene from this pose (is_seen); no value if unknown.
  std::optional<bool> seen = std::nullopt;
  torch::Tensor mask = {};  ///< as Exposure::mask
  double gain = 1;          ///< as Exposure::gain

  static constexpr int64_t kNoTime = INT64_MIN;
  bool has_time() const { return t_us != kNoTime; }
};

struct Dataset {
  std::string name;                       ///< name of the folder
  DatasetKind kind = DatasetKind::kAuto;  ///< as recognised, once it is loaded
  std::string split;  ///< the rule that was applied, in words: "last 5 frames are sharp test views"
  std::filesystem::path root;
  bool monochrome =
      false;  ///< R = G = B in every frame, blurry or sharp; the channels are then bit-equal
  bool undistorted = false;     ///< frames of a lens were undistorted on loading
  std::vector<Exposure> train;  ///< sorted by time if there are times, else by name
  std::vector<SharpView> test;
  /// Exposures that held_out.txt names. Training never sees them; renders blurred along their poses
  /// are scored against them.
  std::vector<Exposure> held_out;
  events::EventStream events;       ///< the whole recording; empty for frames without events
  double near = 0, far = 0;         ///< depth bounds in world units, 0 < near < far
  torch::Tensor points;             ///< [P,3] float32 in world axes, or undefined
  torch::Tensor point_colors;       ///< [P,3] float32 RGB in [0,1], or undefined
  geometry::Trajectory trajectory;  ///< dense camera path; empty if only exposures have poses
  /// Origin of all poses and points here, in the data set's own coordinates; zero unless the scene
  /// is so far from its own origin that float32 would lose precision.
  geometry::Vector3 origin{0, 0, 0};
  std::vector<std::string> notes;  ///< what loading changed in the data, one line each; these are
                                   ///< not problems
  /// [3,H,W] bool, or undefined for gray events and gray frames: the colour of the events at each
  /// pixel. At most one channel of a pixel is set; none if no raw pixel maps to it.
  torch::Tensor event_color;
};

/// Whether the view was taken at mid-exposure: within a sixteenth of the duration (half a step of
/// the nine poses). False if the view has no time, or the exposure no duration.
bool is_mid_exposure(const Exposure& exposure, const SharpView& view);

/// Index of the first training exposure at whose middle the view was taken; -1 if there is none.
int64_t exposure_of(const Dataset& dataset, const SharpView& view);

/// Whether a training exposure sees the scene from the pose of `view`; load_dataset computes it for
/// every test view. A view with a time is seen if the time lies in an exposure, both ends included.
/// A view without a time is seen if it has one of the nine poses of an exposure, to a milliradian
/// and a thousandth of the nearest depth, which moves no point by more than about a pixel.
/// Otherwise it is not seen if the training images are sharp (one pose each), and the result has no
/// value for exposures, because the view may lie between their poses.
std::optional<bool> is_seen(const Dataset& dataset, const SharpView& view);

}  // namespace jade::data
