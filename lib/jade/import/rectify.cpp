// SPDX-License-Identifier: Apache-2.0
#include "jade/import/rectify.h"

#include <cmath>
#include <torch/types.h>

#include "jade/core/error.h"

namespace jade::import {
namespace {

/// Multiple of the plane's depth at which the parallax is invisible.
constexpr double kFarAway = 1e6;

}  // namespace

Rectification rectification(const RectifyCameras& cameras, const RectifyOptions& options) {
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

}  // namespace jade::import
