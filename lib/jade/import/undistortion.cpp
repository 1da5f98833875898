// SPDX-License-Identifier: Apache-2.0
#include "jade/import/undistortion.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/core/log.h"
#include "jade/core/readable.h"
#include "jade/core/text.h"
#include "jade/data/warnings.h"
#include "jade/events/warp.h"
#include "jade/imaging/warp.h"

namespace jade::import {
namespace {

/// Largest distance of a principal point from the image centre, relative to the image's size.
constexpr double kFarFromMiddle = 0.15;
/// Shares of the events allowed to fall outside the image, before a warning and before an error. A
/// lens with a wide margin loses a fifth.
constexpr double kManyLost = 0.4, kMostLost = 0.9;
/// Frames with more pixels than this per pixel of the event sensor, per side, are scaled to it.
constexpr double kFiner = 1.2;
/// Multiple of the plane's depth at which the parallax is invisible.
constexpr double kFarAway = 1e6;

/// A view of over 150 or under 6 degrees is rare.
void warn_of_view(const Calibration& calibration, const Capture& capture) {
  constexpr double kWidest = 0.13, kNarrowest = 10;  // focal length per side
  const CalibratedCamera& camera = calibration.cameras[0];
  const double f = camera.fx / double(std::max(capture.width(), capture.height()));
  if (f >= kWidest && f <= kNarrowest) return;
  log_warn(concat(calibration.path.string(), ": focal length ", camera.fx, " px is ",
                  f < 1 ? "short" : "long", " for ", capture.width(), "x", capture.height(),
                  " frames; is it in pixels, and of this size?"));
}

/// A file without a size may be for another one.
void warn_of_size(const Calibration& calibration, size_t index, const Capture& capture) {
  const CalibratedCamera& camera = calibration.cameras[index];
  if (camera.width > 0) return;
  const double width = double(capture.width()), height = double(capture.height());
  const double off =
      std::max(std::abs(camera.cx / width - 0.5), std::abs(camera.cy / height - 0.5));
  if (off < kFarFromMiddle) return;
  log_warn(concat(calibration.path.string(), ": principal point (", camera.cx - 0.5, ", ",
                  camera.cy - 0.5, ") lies far from the middle of ", capture.width(), "x",
                  capture.height(), " frames; was it calibrated at another size?"));
}

void warn_of_unused(const Calibration& calibration) {
  if (calibration.unused.empty()) return;
  const bool rig = calibration.second_from_first.has_value();
  log_warn(concat(calibration.path.string(), ": expected cam0 (of the frames) and cam1 (of the ",
                  "events) at most, found ", listing(calibration.unused, 4), " too; ",
                  rig ? "cam0 and cam1 are" : "cam0 is",
                  " used, keep only the cameras of this recording, as cam0 and cam1"));
}

RectifyCameras cameras_of(const Calibration& calibration, const Capture& capture) {
  RectifyCameras cameras{camera_of(calibration, 0, capture.width(), capture.height(), "frames")};
  if (calibration.second_from_first) {
    cameras.events = geometry::Rig{
        camera_of(calibration, 1, capture.sensor.width, capture.sensor.height, "events"),
        *calibration.second_from_first};
  } else {
    camera_of(calibration, 0, capture.sensor.width, capture.sensor.height, "events");
  }
  return cameras;
}

/// [C,H,W] float32, averaged over the pixels of the larger image.
torch::Tensor scaled(const torch::Tensor& image, int64_t height, int64_t width) {
  return at::_upsample_bilinear2d_aa(image.unsqueeze(0), {height, width}, false).squeeze(0);
}

/// A pixel of the smaller mask counts if all pixels that it averages count.
torch::Tensor scaled_mask(const torch::Tensor& mask, int64_t height, int64_t width) {
  return scaled(mask.to(torch::kFloat32), height, width) > 1 - 1e-4;
}

/// Scales frames to the pixels of an event sensor that is coarser. An event moves to one frame
/// pixel, so of several frame pixels per event pixel the others would stay as blurred as they are.
/// @return a text for the summary; empty if nothing changes
std::string scale_finer_frames(RectifyCameras& cameras, Capture& capture) {
  if (!cameras.events) return "";
  const geometry::Intrinsics from = cameras.frames.pinhole();
  const double finer = from.fx / cameras.events->second.pinhole().fx;
  if (finer <= kFiner) return "";
  geometry::Intrinsics to = from;
  to.width = std::llround(double(from.width) / finer);
  to.height = std::llround(double(from.height) / finer);
  const double x = double(to.width) / double(from.width);
  const double y = double(to.height) / double(from.height);
  to.fx *= x, to.cx *= x, to.fy *= y, to.cy *= y;
  cameras.frames = geometry::LensCamera(to, cameras.frames.lens());
  for (Shot& shot : capture.shots) {
    shot.image = scaled(shot.image, to.height, to.width);
    if (shot.mask.defined()) shot.mask = scaled_mask(shot.mask, to.height, to.width);
  }
  if (capture.mask.defined()) capture.mask = scaled_mask(capture.mask, to.height, to.width);
  return concat("frames scaled from ", from.width, "x", from.height, " to ", to.width, "x",
                to.height, ", because the event sensor has no finer pixels, ");
}

std::string parallax_said(const LensOptions& options, const Rectification& to) {
  const auto at = [](double depth, const char* unknown) {
    return depth > 0 ? concat("at ", depth) : unknown;
  };
  return concat(", the plane leaves ", to.at_near.largest_px, " px ",
                at(options.near, "at half its depth"), " and ", to.at_far.largest_px, " px ",
                at(options.far, "far away"));
}

/// Calibrations of other cameras, and plane depths in another unit, move many events outside.
void check_loss(const events::WarpedEvents& moved, int64_t all, const LensOptions& options,
                bool rig) {
  const double lost = all > 0 ? double(moved.dropped) / double(all) : 0;
  if (lost < kManyLost) return;
  const std::string said =
      concat("undistort: expected most events to fall on the frames, found ", moved.dropped, " of ",
             all, " beside them; ",
             rig ? concat("is --plane-depth ", options.plane_depth,
                          " in the unit of the calibration's translation, and cam0 the camera of "
                          "the frames?")
                 : std::string("is the calibration of this camera at this size?"));
  if (lost > kMostLost) throw DataError(said);
  log_warn(said);
}

}  // namespace

Rectification rectification(const RectifyCameras& cameras, const LensOptions& options) {
  Rectification result;
  result.camera = geometry::rectified_camera(cameras.frames, options.field);
  result.frame_map = geometry::undistortion_map(cameras.frames, result.camera);
  if (!cameras.events) {
    result.event_map = geometry::rectification_map(cameras.frames, result.camera);
    return result;
  }
  const double depth = options.plane_depth;
  if (!(depth > 0) || !std::isfinite(depth)) {
    throw ConfigError(
        concat("--plane-depth: expected the distance at which frames and events of two cameras are "
               "to agree, in the calibration's unit (metres), found ",
               depth));
  }
  const double near = options.near > 0 ? options.near : 0.5 * depth;
  const double far = options.far > 0 ? options.far : kFarAway * depth;
  if (!(near <= depth && depth <= far)) {
    throw ConfigError(concat("--plane-depth: expected lens.near (", near,
                             ") or more, and lens.far (", far, ") or less, found ", depth));
  }
  const geometry::Rig& rig = *cameras.events;
  result.event_map = geometry::plane_map(rig, result.camera, depth);
  result.at_near = geometry::plane_parallax(rig, result.camera, depth, near);
  result.at_far = geometry::plane_parallax(rig, result.camera, depth, far);
  return result;
}

events::ImageSize reach_of(const events::EventStream& events) {
  if (events.empty()) return {};
  const auto reach = [](const torch::Tensor& places) {
    return int64_t(std::floor(places.nan_to_num(0, 0, 0).max().item<double>() + 0.5)) + 1;
  };
  return {reach(events.y()), reach(events.x())};
}

std::optional<Calibration> calibration_of(const LensOptions& options,
                                          const std::filesystem::path& kept) {
  const std::filesystem::path& path = options.calibration.empty() ? kept : options.calibration;
  std::optional<Calibration> calibration;
  if (!path.empty()) calibration = read_calibration(path);
  if (is_rig(calibration) && !(options.plane_depth > 0)) {
    throw ConfigError(concat(
        "--plane-depth: ", path.string(),
        " is of two cameras, cam0 of the frames and cam1 of the events; expected the distance "
        "at which their pictures are to agree, in metres, that of most of the scene, found "
        "none; if one sensor takes both, keep its camera only, as cam0"));
  }
  if (!is_rig(calibration) && options.plane_depth > 0) {
    throw ConfigError(
        concat("--plane-depth: expected a calibration of two cameras (Kalibr's cam0 "
               "and cam1), found ",
               calibration ? "one camera in " + path.string() : "none"));
  }
  return calibration;
}

bool is_rig(const std::optional<Calibration>& calibration) {
  return calibration && calibration->second_from_first;
}

void settle_sensor(Calibration& calibration, Capture& capture) {
  const std::string order = put_frames_first(calibration, capture.width(), capture.height());
  if (!order.empty()) log_warn(order);
  if (calibration.second_from_first && !capture.sensor_is_said) {
    const CalibratedCamera& second = calibration.cameras[1];
    const events::ImageSize reach = reach_of(capture.events);
    capture.sensor = {std::max(second.height, reach.height), std::max(second.width, reach.width)};
  }
  cameras_of(calibration, capture);
  warn_of_unused(calibration);
  warn_of_view(calibration, capture);
  warn_of_size(calibration, 0, capture);
}

std::string undistort(const LensOptions& options, const Calibration& calibration,
                      Capture& capture) {
  RectifyCameras cameras = cameras_of(calibration, capture);
  std::string said = scale_finer_frames(cameras, capture);
  const Rectification to = rectification(cameras, options);
  for (Shot& shot : capture.shots) {
    throw_if_interrupted();
    shot.image = imaging::remap(shot.image, to.frame_map).clamp(0, 1);
    if (shot.mask.defined()) shot.mask = imaging::remap_mask(shot.mask, to.frame_map);
  }
  if (capture.mask.defined()) capture.mask = imaging::remap_mask(capture.mask, to.frame_map);
  const events::WarpedEvents moved =
      events::warp(capture.events, to.event_map, {to.camera.height, to.camera.width});
  check_loss(moved, capture.events.size(), options, cameras.events.has_value());
  capture.events = moved.events;
  capture.event_map = to.event_map;
  capture.camera = to.camera;
  said += concat("focal length ", readable(to.camera.fx, 4), " px, ", moved.dropped,
                 " events beside the image");
  if (cameras.events) said += parallax_said(options, to);
  return said;
}

}  // namespace jade::import
