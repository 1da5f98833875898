// SPDX-License-Identifier: Apache-2.0
#include "jade/serve/wanted.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <vector>

#include "jade/core/error.h"

namespace jade::serve {
namespace {

constexpr double kLargestNumber = 1e9;  ///< of a pose or a camera
constexpr size_t kLongestName = 200;

/// Exactly `count` comma-separated numbers within limits.
std::vector<double> numbers(const Parameter& parameter, const char* name, size_t count) {
  const std::string text = parameter(name);
  std::vector<double> values;
  const char* from = text.data();
  const char* const end = from + text.size();
  while (from < end && values.size() <= count) {
    double value = 0;
    const auto [next, error] = std::from_chars(from, end, value);
    if (error != std::errc() || !(std::abs(value) < kLargestNumber)) break;
    values.push_back(value);
    from = next;
    if (from == end || *from != ',') break;
    ++from;
  }
  if (values.size() != count || from != end) {
    throw ConfigError(concat(name, ": expected ", count, " numbers with commas between"));
  }
  return values;
}

geometry::Pose pose_of(const Parameter& parameter) {
  const std::vector<double> rows = numbers(parameter, "pose", 12);
  geometry::Pose pose;
  for (size_t r = 0; r < 3; ++r) {
    for (size_t c = 0; c < 3; ++c) pose.rotation[3 * r + c] = rows[4 * r + c];
    pose.translation[r] = rows[4 * r + 3];
  }
  try {
    pose.rotation = geometry::nearest_rotation(pose.rotation);
  } catch (const Error&) {
    throw ConfigError("pose: expected a rotation beside the translation");
  }
  return pose;
}

geometry::Intrinsics camera_of(const Parameter& parameter) {
  const std::vector<double> n = numbers(parameter, "camera", 6);
  const auto size = [](double value) {
    return value >= 1 && value <= 8192 && value == std::floor(value) ? int64_t(value) : 0;
  };
  const geometry::Intrinsics camera{n[0], n[1], n[2], n[3], size(n[4]), size(n[5])};
  const int64_t pixels = camera.width * camera.height;
  if (!(camera.fx > 0 && camera.fy > 0) || pixels < 1 || pixels > Wanted::kMostPixels) {
    throw ConfigError(
        concat("camera: expected positive focal lengths and a whole width and height "
               "of at most ",
               Wanted::kMostPixels, " pixels in all"));
  }
  return camera;
}

std::string name_of(const Parameter& parameter, const char* name) {
  const std::string text = parameter(name);
  if (text.empty() || text.size() > kLongestName) {
    throw ConfigError(concat(name, ": expected 1 to ", kLongestName, " characters"));
  }
  return text;
}

}  // namespace

Wanted wanted_frame(const Parameter& parameter) {
  Wanted wanted;
  const std::string layer = parameter("layer");
  if (layer != "color" && layer != "depth") {
    throw ConfigError("layer: expected color or depth");
  }
  if (layer == "depth") wanted.kind = Wanted::Kind::kDepth;
  wanted.pose = pose_of(parameter);
  wanted.camera = camera_of(parameter);
  if (!parameter("view").empty()) wanted.view = name_of(parameter, "view");
  return wanted;
}

Wanted wanted_picture(const Parameter& parameter) {
  Wanted wanted;
  wanted.kind = Wanted::Kind::kPicture;
  wanted.view = name_of(parameter, "view");
  wanted.picture = name_of(parameter, "name");
  return wanted;
}

Wanted wanted_camera(const Parameter& parameter) {
  Wanted wanted;
  wanted.kind = Wanted::Kind::kCamera;
  wanted.view = name_of(parameter, "view");
  return wanted;
}

std::string viewer_of(const Parameter& parameter) {
  std::string viewer = parameter("viewer");
  const bool plain = std::all_of(viewer.begin(), viewer.end(), [](char c) {
    return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
  });
  if (viewer.empty() || viewer.size() > 32 || !plain) {
    throw ConfigError("viewer: expected 1 to 32 letters and digits");
  }
  return viewer;
}

}  // namespace jade::serve
