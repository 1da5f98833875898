// SPDX-License-Identifier: Apache-2.0
#include "jade/geometry/lens.h"

#include "support/catch.h"

#include <cmath>

#include "jade/core/error.h"

using namespace jade::geometry;

namespace {

const Intrinsics kSensor{200, 205, 88, 61, 173, 130};
const Lens kBarrel{LensModel::kRadialTangential, -0.35, 0.12, 1e-3, -7e-4, 0.01, 0, 0, 0};
const Lens kRational{LensModel::kRational, 0.3, -0.1, 1e-3, 2e-3, 0.02, 0.65, -0.12, 0.05};
const Lens kFisheye{LensModel::kFisheye, 0.02, -0.008, 0, 0, 0.004, -0.001, 0, 0};
const Lens kFieldOfView{LensModel::kFieldOfView, 0.9};
const Lens kDivision{LensModel::kDivision, -0.1};
const Lens kUnified{LensModel::kUnified, 0.6, 1.1};
const Lens kPrism{
    LensModel::kPrismFisheye, 0.02, -0.01, 0.003, -0.002, 0.004, -0.001, 0, 0, 0.005, 0, -0.006};
const Lens kRadialPrism{LensModel::kRadialPrismFisheye,
                        0.02,
                        -0.01,
                        -0.002,
                        0.003,
                        0.004,
                        -0.001,
                        0.002,
                        -0.0005,
                        0.005,
                        0.001,
                        -0.006,
                        0.002};

}  // namespace

TEST_CASE("lens: unproject undoes project, for every model", "[geometry]") {
  for (const Lens& lens : {Lens{}, kBarrel, kRational, kFisheye, kFieldOfView, kDivision, kUnified,
                           kPrism, kRadialPrism}) {
    const LensCamera camera(kSensor, lens);
    for (double x = -0.45; x <= 0.45; x += 0.09) {
      for (double y = -0.35; y <= 0.35; y += 0.07) {
        const auto place = camera.project({2 * x, 2 * y, 2});
        const Vector3 back = camera.unproject(place[0], place[1]);
        CHECK(back[0] / back[2] == Approx(x).margin(1e-9));
        CHECK(back[1] / back[2] == Approx(y).margin(1e-9));
        CHECK(std::hypot(back[0], back[1], back[2]) == Approx(1).epsilon(1e-12));
      }
    }
  }
}

TEST_CASE("lens: coefficients follow OpenCV's formulas", "[geometry]") {
  const Intrinsics plain{1, 1, 0, 0, 2, 2};
  const Lens lens{LensModel::kRational, 0.1, 0.2, 0.01, 0.02, 0.3, 0.4, 0.5, 0.6};
  const auto bent = LensCamera(plain, lens).project({0.5, -0.25, 1});
  const double rho = 0.3125, cube = rho * rho * rho;
  const double r = (1 + 0.1 * rho + 0.2 * rho * rho + 0.3 * cube) /
                   (1 + 0.4 * rho + 0.5 * rho * rho + 0.6 * cube);
  CHECK(bent[0] == Approx(0.5 * r - 2 * 0.01 * 0.125 + 0.02 * (rho + 0.5)));
  CHECK(bent[1] == Approx(-0.25 * r + 0.01 * (rho + 0.125) - 2 * 0.02 * 0.125));

  const double t = std::atan2(5, -1), s = t * t;
  const Lens even{LensModel::kFisheye, 0.02, 0, 0, 0, 0, 0, 0, 0};
  const auto behind = LensCamera(plain, even).project({3, 4, -1});
  CHECK(behind[0] == Approx(0.6 * t * (1 + 0.02 * s)));
  CHECK(behind[1] == Approx(0.8 * t * (1 + 0.02 * s)));
}

TEST_CASE("lens: places of points are those that pycolmap 4.2.1 computes", "[geometry]") {
  const Intrinsics sensor{500, 510, 320, 240, 640, 480};
  const auto check = [&](const Lens& lens, double u, double v) {
    const auto place = LensCamera(sensor, lens).project({-0.7, 0.5, 1.1});
    CHECK(place[0] == Approx(u).margin(1e-5));
    CHECK(place[1] == Approx(v).margin(1e-5));
  };
  check(kFieldOfView, 27.49499686, 453.110788);
  check(kDivision, 19.2083055, 459.14823456);
  check(kUnified, 49.43809193, 437.12367588);
  check(kPrism, 47.48315129, 438.35543695);
  check(kRadialPrism, 51.22039249, 435.58065025);
  check(kFisheye, 47.92599062723576, 438.22534968587115);
  check(kRational, 52.735038708946036, 435.47908809056605);
}

TEST_CASE("lens: a fisheye sees beyond the right angle", "[geometry]") {
  const LensCamera camera({100, 100, 300, 300, 600, 600}, {LensModel::kFisheye});
  const Vector3 direction = camera.unproject(300 + 100 * 1.8, 300);
  CHECK(direction[0] == Approx(std::sin(1.8)));
  CHECK(direction[2] == Approx(std::cos(1.8)));
}

TEST_CASE("lens: beyond the fold nothing is seen twice", "[geometry]") {
  const Lens lens{LensModel::kRadialTangential, -0.35};
  const LensCamera camera(kSensor, lens);
  // s (1 − 0.35 s²) has its maximum at s = 1/√1.05.
  CHECK(std::tan(camera.largest_angle()) == Approx(1 / std::sqrt(1.05)).epsilon(1e-6));
  CHECK(std::isnan(camera.project({1.1, 0, 1})[0]));
  CHECK(std::isnan(camera.project({0.1, 0, -1})[0]));
  CHECK(std::isnan(camera.unproject(kSensor.cx + 2 * kSensor.fx, kSensor.cy)[0]));
  CHECK_THROWS_AS(LensCamera(kSensor, {LensModel::kRadialTangential, std::nan("")}),
                  jade::ContractError);
}
