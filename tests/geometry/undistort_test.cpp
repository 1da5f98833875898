// SPDX-License-Identifier: Apache-2.0
#include "jade/geometry/undistort.h"

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

using namespace jade::geometry;

namespace {

const Intrinsics kRaw{200, 205, 88, 61, 173, 130};
const Intrinsics kRectified{190, 190, 80, 60, 160, 120};
const Distortion kLens{-0.35, 0.12, 1e-3, -7e-4, 0.01};

}  // namespace

TEST_CASE("undistort: the inverse undoes the lens", "[geometry]") {
  for (double x = -0.45; x <= 0.45; x += 0.09) {
    for (double y = -0.35; y <= 0.35; y += 0.07) {
      const auto bent = distort(kLens, x, y);
      const auto back = undistort(kLens, bent[0], bent[1]);
      CHECK(back[0] == Approx(x).margin(1e-10));
      CHECK(back[1] == Approx(y).margin(1e-10));
    }
  }
}

TEST_CASE("undistort: coefficients follow OpenCV's formula", "[geometry]") {
  const auto bent = distort({0.1, 0.2, 0.01, 0.02, 0.3}, 0.5, -0.25);
  const double rho = 0.3125, radial = 1 + 0.1 * rho + 0.2 * rho * rho + 0.3 * rho * rho * rho;
  CHECK(bent[0] == Approx(0.5 * radial - 2 * 0.01 * 0.125 + 0.02 * (rho + 0.5)));
  CHECK(bent[1] == Approx(-0.25 * radial + 0.01 * (rho + 0.125) - 2 * 0.02 * 0.125));
}

TEST_CASE("undistort: beyond the fold of the lens there is no direction", "[geometry]") {
  CHECK(std::isnan(undistort({-0.35, 0, 0, 0, 0}, 2.0, 0.0)[0]));
}

TEST_CASE("undistort: the maps of frames and of events are inverse", "[geometry]") {
  const auto frames = undistortion_map(kRaw, kLens, kRectified);
  const auto events = rectification_map(kRaw, kLens, kRectified);
  CHECK(frames.sizes() == torch::IntArrayRef({2, 120, 160}));
  CHECK(events.sizes() == torch::IntArrayRef({2, 130, 173}));
  const auto round = sample(events, frames);  // rectified pixel → raw place → rectified place
  for (int64_t row = 10; row < 110; row += 9) {
    for (int64_t column = 10; column < 150; column += 7) {
      CHECK(round[0][row][column].item<float>() == Approx(float(column)).margin(0.02));
      CHECK(round[1][row][column].item<float>() == Approx(float(row)).margin(0.02));
    }
  }
}

TEST_CASE("undistort: without distortion and with one camera nothing moves", "[geometry]") {
  const auto image = torch::rand({3, 130, 173});
  const auto same = sample(image, undistortion_map(kRaw, {}, kRaw));
  CHECK(same.sub(image).abs().max().item<float>() < 1e-3f);
  auto map = undistortion_map(kRaw, {}, kRaw);
  map.fill_(std::nanf(""));
  CHECK(sample(image, map).abs().max().item<float>() == 0.0f);
}
