// SPDX-License-Identifier: Apache-2.0
// The one in-memory form of a data set, whatever the source.
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

/// The layout of a data set's folder; kAuto is for those who ask that it be recognised.
enum class DatasetKind { kAuto, kEvDeblur, kDietGs, kColmap, kTransforms };

constexpr auto words_of(DatasetKind) {
  return std::array{Word{"auto", DatasetKind::kAuto}, Word{"evdeblur", DatasetKind::kEvDeblur},
                    Word{"diet_gs", DatasetKind::kDietGs}, Word{"colmap", DatasetKind::kColmap},
                    Word{"transforms", DatasetKind::kTransforms}};
}

/// One training item: a frame that integrated light over [t_start_us, t_end_us) while the camera
/// passed through nine poses at equal steps in time, the fifth at mid-exposure.
/// A sharp training image (plain_3dgs) is an exposure of no duration: nine equal poses, no events.
struct Exposure {
  std::string name;      ///< image file name without extension
  torch::Tensor blurry;  ///< [3,H,W] RGB float32 in [0,1], CPU
  int64_t t_start_us = 0, t_end_us = 0;
  events::EventStream events;  ///< the window's events, a view of Dataset::events
  std::array<geometry::Pose, geometry::kExposurePoses> poses;  ///< camera_from_world
  geometry::Intrinsics camera;
  torch::Tensor mask;  ///< [1,H,W] bool, true: the pixel counts; undefined: all pixels count
  double gain = 1;     ///< of the frame: its brightness is that of the scene times this

  int64_t duration_us() const { return t_end_us - t_start_us; }
  int64_t t_mid_us() const { return t_start_us + duration_us() / 2; }
};

/// A sharp image for evaluation; training never sees it.
struct SharpView {
  std::string name;
  torch::Tensor image;  ///< [3,H,W] RGB float32 in [0,1], CPU
  geometry::Pose pose;  ///< camera_from_world
  geometry::Intrinsics camera;
  int64_t t_us = kNoTime;  ///< when it was taken; kNoTime if the data set does not say
  /// Whether training sees the scene from there (is_seen); absent where nobody knows.
  std::optional<bool> seen = std::nullopt;
  torch::Tensor mask = {};  ///< as Exposure::mask
  double gain = 1;          ///< as Exposure::gain

  static constexpr int64_t kNoTime = INT64_MIN;
  bool has_time() const { return t_us != kNoTime; }
};

struct Dataset {
  std::string name;                       ///< of the folder
  DatasetKind kind = DatasetKind::kAuto;  ///< as found, once it is loaded
  std::string split;  ///< the rule found, in words: "last 5 frames are sharp test views"
  std::filesystem::path root;
  bool monochrome =
      false;  ///< R = G = B in every frame, blurry or sharp; channels then are bit-equal
  std::vector<Exposure> train;  ///< by time where there are times, else by name
  std::vector<SharpView> test;
  /// Exposures that held_out.txt names: training never sees them, a render that is blurred along
  /// their poses is scored against them.
  std::vector<Exposure> held_out;
  events::EventStream events;       ///< the whole recording; empty for frames without events
  double near = 0, far = 0;         ///< depth bounds in world units, 0 < near < far
  torch::Tensor points;             ///< [P,3] float32 in world axes, or undefined
  torch::Tensor point_colors;       ///< [P,3] float32 RGB in [0,1], or undefined
  geometry::Trajectory trajectory;  ///< dense camera path; empty where only exposures have poses
  /// The point of the data set's own coordinates that is the origin of all poses and points here;
  /// zero unless these lie so far from their origin that float32 would blur the scene.
  geometry::Vector3 origin{0, 0, 0};
  std::vector<std::string> notes;  ///< what loading did to the data, a line each; no problems
  /// [3,H,W] bool, or undefined for gray events and gray frames: which colour the events at a pixel
  /// have. At most one channel of a pixel is set; a pixel without any has no raw pixel that lands
  /// on it.
  torch::Tensor event_color;
};

/// The exposure at whose middle `view` was taken: mid-exposure within a sixteenth of the exposure
/// (half a step of its nine poses) of the view's time. -1 if there is none or the view has no time.
int64_t exposure_of(const Dataset& dataset, const SharpView& view);

/// Whether a training exposure sees the scene from where `view` was taken; load_dataset asks it for
/// every test view. With a time: it lies in an exposure, both ends included. Without one: the view
/// has one of the nine poses of an exposure, to a milliradian and a thousandth of the nearest
/// depth, which moves no point by more than a pixel or so. A view without a time that has none of
/// these is not seen by sharp images, taken at their pose alone, but may lie between the poses of
/// an exposure: absent then.
std::optional<bool> is_seen(const Dataset& dataset, const SharpView& view);

}  // namespace jade::data
