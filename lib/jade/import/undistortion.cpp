// SPDX-License-Identifier: Apache-2.0
#include "jade/import/undistortion.h"

#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/imaging/warp.h"
#include "jade/import/calibration.h"
#include "jade/import/rectify.h"

namespace jade::import {
namespace {

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

}  // namespace

std::string undistort(const LensOptions& options, Capture& capture) {
  const Calibration calibration = read_calibration(options.calibration);
  const RectifyCameras cameras = cameras_of(calibration, capture);
  const Rectification to =
      rectification(cameras, {options.field, options.plane_depth, options.near, options.far});
  for (Shot& shot : capture.shots) {
    throw_if_interrupted();
    shot.image = imaging::remap(shot.image, to.frame_map).clamp(0, 1);
  }
  const RectifiedEvents moved =
      rectify_events(capture.events, to.event_map, {to.camera.height, to.camera.width});
  capture.events = moved.events;
  capture.event_map = to.event_map;
  capture.camera = to.camera;
  std::string said =
      concat("focal length ", to.camera.fx, " px, ", moved.dropped, " events beside the image");
  if (cameras.events && options.far > 0) {
    said += concat(", the plane leaves ", to.at_near.largest_px, " px at ", options.near, " and ",
                   to.at_far.largest_px, " px at ", options.far);
  }
  return said;
}

}  // namespace jade::import
