// SPDX-License-Identifier: Apache-2.0
#include "jade/data/transforms_json.h"

#include "support/catch.h"

namespace jade::data {
namespace {

using nlohmann::json;

TEST_CASE("transforms json: a frame's own focal length or field of view comes before the file's",
          "[data]") {
  const auto focal = [](const json& root, const json& frame) {
    return camera_of_frame(root, frame, "frame").fx;
  };
  const auto angle = [](const json& root, const json& frame) {
    return angle_of(root, frame, 'x', "frame");
  };
  const json focal_file{{"fl_x", 50}, {"fl_y", 60}}, angle_file{{"camera_angle_x", 0.8}};
  CHECK(focal(focal_file, json::object()) == 50);
  CHECK(focal(focal_file, {{"fl_x", 40}}) == 40);
  for (const char* key : {"camera_angle_x", "x_fov"}) {
    const json frame{{key, 1.5}};
    CHECK(focal(focal_file, frame) == 0);
    CHECK(camera_of_frame(focal_file, frame, "frame").fy == 0);
    CHECK(angle(focal_file, frame) > 0);
  }
  CHECK(angle(angle_file, json::object()) == 0.8);
  CHECK(angle(angle_file, {{"x_fov", 90}}) == Approx(1.5707963));
  CHECK(angle(angle_file, {{"fl_y", 40}}) == 0);
  CHECK(focal(angle_file, {{"fl_x", 40}}) == 40);
  CHECK(lens_of_frame({{"is_fisheye", true}}, {{"camera_model", "OPENCV"}}, "frame").model ==
        geometry::LensModel::kRadialTangential);
}

}  // namespace
}  // namespace jade::data
