// SPDX-License-Identifier: Apache-2.0
#include "jade/import/undistortion.h"

#include "support/catch.h"

#include <torch/types.h>

using namespace jade;

namespace {

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

  std::string undistort() {
    import::LensOptions options;
    options.plane_depth = 1;
    return import::undistort(options, calibration, capture);
  }
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
