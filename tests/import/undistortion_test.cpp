// SPDX-License-Identifier: Apache-2.0
#include "jade/import/undistortion.h"

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/events/warp.h"
#include "jade/imaging/warp.h"

using namespace jade;

namespace {

const geometry::LensCamera kLens({120, 121, 52, 37, 100, 80},
                                 {geometry::LensModel::kRadialTangential, -0.3, 0.1, 1e-3, -1e-3, 0,
                                  0, 0, 0});

/// A blob on the plane z = 1 as the raw camera sees it.
torch::Tensor raw_picture(const geometry::LensCamera& camera, double x, double y) {
  auto image = torch::zeros({1, camera.pinhole().height, camera.pinhole().width}, torch::kFloat32);
  const auto place = camera.project({x, y, 1});
  for (int64_t i = 0; i < image.size(1); ++i) {
    for (int64_t j = 0; j < image.size(2); ++j) {
      const double d = std::hypot(double(j) + 0.5 - place[0], double(i) + 0.5 - place[1]);
      image[0][i][j] = std::exp(-0.5 * d * d / 4);
    }
  }
  return image;
}

/// Centre of the blob, in pixel indices.
std::array<double, 2> middle(const torch::Tensor& image) {
  const auto weight = image[0].to(torch::kFloat64);
  const double sum = weight.sum().item<double>();
  const auto columns = torch::arange(image.size(2), torch::kFloat64);
  const auto rows = torch::arange(image.size(1), torch::kFloat64);
  return {(weight.sum(0) * columns).sum().item<double>() / sum,
          (weight.sum(1) * rows).sum().item<double>() / sum};
}

import::LensOptions at_depth(double plane, double near = 0,
                             double far = 0){import::LensOptions options;
options.plane_depth = plane, options.near = near, options.far = far;
return options;
}  // namespace

/// Two cameras at one place behind a beam splitter; the frames have `times` the event sensor's
/// pixels per side. The frames are dark at the left and bright at the right.
struct BeamSplitter {
  import::Calibration calibration;
  import::Capture capture;

  explicit BeamSplitter(double times) {
    const auto camera = [](const char* name, int64_t width, int64_t height) {
      import::CalibratedCamera made;
      made.name = name;
      made.fx = made.fy = 0.8 * double(width);
      made.cx = 0.5 * double(width), made.cy = 0.5 * double(height);
      made.width = width, made.height = height;
      return made;
    };
    const auto width = std::llround(40 * times), height = std::llround(30 * times);
    calibration.cameras = {camera("cam0", width, height), camera("cam1", 40, 30)};
    calibration.second_from_first = geometry::Pose();
    const torch::Tensor ramp = (torch::arange(width) + 0.5) / double(width);
    import::Shot shot;
    shot.image = ramp.expand({3, height, width}).to(torch::kFloat32).contiguous();
    shot.mask = torch::ones({1, height, width}, torch::kBool);
    shot.mask[0][0][0] = false;
    capture.shots = {shot};
    capture.sensor = {30, 40};
    capture.events = events::EventStream::from_lists({10, 25}, {12, 20}, {1, 2}, {1, -1});
  }

  std::string undistort() { return import::undistort(at_depth(1), calibration, capture); }
};

}  // namespace

TEST_CASE("undistortion: frames finer than the event sensor take its pixels", "[import]") {
  BeamSplitter finer(2);
  CHECK_THAT(finer.undistort(), Catch::Contains("from 80x60 to 40x30"));
  const import::Capture& capture = finer.capture;
  CHECK((capture.width() == 40 && capture.height() == 30));
  CHECK(capture.camera->fx == Approx(32).epsilon(0.05));
  CHECK(capture.events.x()[0].item<float>() == Approx(10).margin(0.6));
  CHECK(capture.events.y()[1].item<float>() == Approx(20).margin(0.6));
  // The ramp keeps its place.
  const torch::Tensor row = capture.shots[0].image[0][15];
  CHECK(row[20].item<float>() == Approx(20.5 / 40).margin(0.01));
  CHECK(row[5].item<float>() == Approx(5.5 / 40).margin(0.02));
  CHECK_FALSE(capture.shots[0].mask[0][0][0].item<bool>());
  CHECK(capture.shots[0].mask[0][15][20].item<bool>());
}

TEST_CASE("undistortion: frames about as fine as the event sensor keep their size", "[import]") {
  for (const double times : {0.5, 1.0, 1.15}) {
    BeamSplitter same(times);
    CHECK_THAT(same.undistort(), !Catch::Contains("scaled"));
    CHECK(same.capture.width() == std::llround(40 * times));
  }
}

TEST_CASE("undistortion: frames and events of one sensor land on one another", "[import]") {
  const auto plan = import::rectification({kLens}, {});
  for (const auto& [x, y] : {std::pair{0.0, 0.0}, std::pair{0.25, -0.2}, std::pair{-0.28, 0.2}}) {
    const auto want = geometry::project(plan.camera, {x, y, 1});
    const auto place = middle(imaging::remap(raw_picture(kLens, x, y), plan.frame_map));
    CHECK(place[0] == Approx(want[0] - 0.5).margin(0.15));
    CHECK(place[1] == Approx(want[1] - 0.5).margin(0.15));
    const auto raw = kLens.project({x, y, 1});
    const auto moved = events::warp(
        events::EventStream::from_lists({float(raw[0] - 0.5)}, {float(raw[1] - 0.5)}, {7}, {-1}),
        plan.event_map, {80, 100});
    REQUIRE(moved.events.size() == 1);
    CHECK(moved.events.x()[0].item<float>() == Approx(want[0] - 0.5).margin(0.01));
    CHECK(moved.events.y()[0].item<float>() == Approx(want[1] - 0.5).margin(0.01));
    CHECK(moved.events.t_us()[0].item<int64_t>() == 7);
    CHECK(moved.events.polarity()[0].item<int8_t>() == -1);
  }
}

TEST_CASE("undistortion: events of a second camera meet the frames on the plane", "[import]") {
  const geometry::LensCamera second({150, 150, 64, 48, 128, 96}, {});
  const geometry::Pose pose{geometry::rotation_from_vector({0.01, 0.02, -0.03}), {0.05, 0, 0.01}};
  const import::RectifyCameras cameras{kLens, geometry::Rig{second, pose}};
  const auto plan = import::rectification(cameras, at_depth(1.5, 1, 2));
  const geometry::Vector3 point{0.2, -0.1, 1.5};
  const auto seen = second.project(geometry::transform(pose, point));
  const auto moved = events::warp(
      events::EventStream::from_lists({float(seen[0] - 0.5)}, {float(seen[1] - 0.5)}, {7}, {1}),
      plan.event_map, {80, 100});
  const auto want = geometry::project(plan.camera, point);
  REQUIRE(moved.events.size() == 1);
  CHECK(moved.events.x()[0].item<float>() == Approx(want[0] - 0.5).margin(0.01));
  CHECK(moved.events.y()[0].item<float>() == Approx(want[1] - 0.5).margin(0.01));
  CHECK(plan.at_near.mean_px == Approx(2 * plan.at_far.mean_px).epsilon(0.1));
  CHECK(plan.at_far.mean_px > 0.5);
  const auto unknown = import::rectification(cameras, at_depth(1.5));
  const auto known = import::rectification(cameras, at_depth(1.5, 0.75, 1e9));
  CHECK(unknown.at_near.largest_px == known.at_near.largest_px);
  CHECK(unknown.at_far.largest_px == Approx(known.at_far.largest_px).epsilon(1e-3));
  CHECK_THROWS_AS(import::rectification(cameras, {}), ConfigError);
  CHECK_THROWS_AS(import::rectification(cameras, at_depth(1.5, 2, 3)), ConfigError);
}
