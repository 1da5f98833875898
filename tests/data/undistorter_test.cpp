// SPDX-License-Identifier: Apache-2.0
#include "jade/data/undistorter.h"

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

#include "data/tiny_recording.h"
#include "jade/core/error.h"

namespace jade::data {
namespace {

using geometry::LensModel;

constexpr int64_t kW = 96, kH = 64;
const geometry::Intrinsics kPinhole{70, 72, 47, 33, kW, kH};

/// A pattern on the plane z = 1 seen by the camera, smooth enough for resampling.
torch::Tensor picture(const geometry::LensCamera& camera) {
  torch::Tensor image = torch::zeros({3, kH, kW});
  auto out = image.accessor<float, 3>();
  for (int64_t i = 0; i < kH; ++i) {
    for (int64_t j = 0; j < kW; ++j) {
      const auto direction = camera.unproject(double(j) + 0.5, double(i) + 0.5);
      if (std::isnan(direction[2]) || direction[2] <= 0.05) continue;
      const double x = direction[0] / direction[2], y = direction[1] / direction[2];
      for (int64_t c = 0; c < 3; ++c) {
        out[c][i][j] = float(0.5 + 0.3 * std::sin(5 * x + double(c)) * std::cos(4 * y - double(c)));
      }
    }
  }
  return image;
}

TEST_CASE("undistorter: frames become those of a pinhole, and what has no source is masked",
          "[data]") {
  const torch::Tensor want = picture({kPinhole, {}});
  for (const geometry::Lens& lens :
       {geometry::Lens{LensModel::kRadialTangential, -0.2, 0.05, 1e-3, -1e-3},
        geometry::Lens{LensModel::kRadialTangential, 0.2},
        geometry::Lens{LensModel::kFisheye, 0.02, -0.01},
        geometry::Lens{LensModel::kFieldOfView, 0.8}, geometry::Lens{LensModel::kDivision, -0.2},
        geometry::Lens{LensModel::kUnified, 0.6, 1.1}}) {
    const geometry::LensCamera camera(kPinhole, lens);
    torch::Tensor image = picture(camera), mask;
    Undistorter undistorter;
    CHECK(undistorter.undistort(camera, "camera 1", image, mask) == kPinhole);
    const torch::Tensor counts = mask.defined() ? mask : torch::ones({1, kH, kW}, torch::kBool);
    CHECK(mask.defined() == (lens.k1 == 0.2));
    CHECK(((image - want).abs() * counts).max().item<float>() < 0.03);
    CHECK((image * counts.logical_not()).abs().max().item<float>() == 0);
    std::vector<std::string> warnings, notes;
    undistorter.tell(Warnings(&warnings), notes);
    CHECK(warnings.empty());
    REQUIRE(notes.size() == 1);
    CHECK(notes[0].find("camera 1") != std::string::npos);
    CHECK((notes[0].find("masked") != std::string::npos) == mask.defined());
  }
}

TEST_CASE("undistorter: a lens of less than a pixel is left as it is, and reported", "[data]") {
  const geometry::LensCamera camera(kPinhole, {LensModel::kRadialTangential, 0.005});
  CHECK(lens_shift_px(camera) > 0);
  CHECK(lens_shift_px(camera) < 1);
  torch::Tensor image = torch::rand({3, kH, kW}), mask;
  const torch::Tensor before = image.clone();
  Undistorter undistorter;
  undistorter.undistort(camera, "camera 1", image, mask);
  CHECK(image.equal(before));
  CHECK_FALSE(mask.defined());
  std::vector<std::string> warnings, notes;
  undistorter.tell(Warnings(&warnings), notes);
  CHECK(notes.empty());
  REQUIRE(warnings.size() == 1);
  CHECK(warnings[0].find("camera 1") != std::string::npos);
}

TEST_CASE("undistorter: a lens without coefficients is none", "[data]") {
  torch::Tensor image = torch::rand({3, kH, kW}), mask;
  Undistorter undistorter;
  undistorter.undistort({kPinhole, {LensModel::kRadialTangential}}, "", image, mask);
  std::vector<std::string> warnings, notes;
  undistorter.tell(Warnings(&warnings), notes);
  CHECK(warnings.empty());
  CHECK(notes.empty());
}

TEST_CASE("undistorter: a mask follows its frame", "[data]") {
  const geometry::LensCamera camera(kPinhole, {LensModel::kRadialTangential, -0.2});
  torch::Tensor image = torch::rand({3, kH, kW}), mask = torch::ones({1, kH, kW}, torch::kBool);
  const auto spot = camera.project(geometry::unproject(kPinhole, 80.5, 50.5));
  mask[0][int64_t(spot[1])][int64_t(spot[0])] = false;
  Undistorter().undistort(camera, "", image, mask);
  CHECK_FALSE(mask[0][50][80].item<bool>());
  // Includes the pixels that are interpolated from it.
  CHECK(mask.sum().item<int64_t>() > kW * kH - 40);
}

TEST_CASE("undistorter: cameras of other shapes are refused, of other sizes scaled", "[data]") {
  CHECK(fit_to_picture(kPinhole, 48, 32, "").fx == 35);
  CHECK_THROWS_AS(fit_to_picture(kPinhole, kH, kW, ""), DataError);
  CHECK_THROWS_AS(fit_to_picture(kPinhole, 96, 72, ""), DataError);
}

TEST_CASE("undistorter: events move with the frames, and slices with the events", "[data]") {
  const geometry::LensCamera camera(kPinhole, {LensModel::kRadialTangential, -0.2});
  Dataset data;
  data.events =
      events::EventStream::from_lists({47, 90, 0}, {33, 50, 0}, {100, 200, 300}, {1, -1, 1});
  data.train.resize(1);
  data.train[0].t_start_us = 150;
  data.train[0].t_end_us = 250;
  data.event_color = torch::zeros({3, kH, kW}, torch::kBool);
  data.event_color[1][50][90] = true;
  undistort_events(camera, data);
  // The corner leaves the image.
  REQUIRE(data.events.size() == 2);
  const auto want = geometry::project(kPinhole, camera.unproject(90.5, 50.5));
  REQUIRE(data.train[0].events.size() == 1);
  CHECK(data.train[0].events.x()[0].item<float>() == Approx(want[0] - 0.5).margin(0.01));
  CHECK(data.train[0].events.y()[0].item<float>() == Approx(want[1] - 0.5).margin(0.01));
  CHECK(data.event_color[1].any().item<bool>());
  CHECK(data.notes.size() == 1);
}

}  // namespace
}  // namespace jade::data
