// SPDX-License-Identifier: Apache-2.0
#include "jade/import/rectify.h"

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

}  // namespace

TEST_CASE("rectify: frames and events of one sensor land on one another", "[import]") {
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

TEST_CASE("rectify: events of a second camera meet the frames on the plane", "[import]") {
  const geometry::LensCamera second({150, 150, 64, 48, 128, 96}, {});
  const geometry::Pose pose{geometry::rotation_from_vector({0.01, 0.02, -0.03}), {0.05, 0, 0.01}};
  const import::RectifyCameras cameras{kLens, geometry::Rig{second, pose}};
  const auto plan = import::rectification(cameras, {geometry::RectifiedField::kFilled, 1.5, 1, 2});
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
  const auto unknown = import::rectification(cameras, {geometry::RectifiedField::kFilled, 1.5});
  const auto known = import::rectification(cameras, {{}, 1.5, 0.75, 1e9});
  CHECK(unknown.at_near.largest_px == known.at_near.largest_px);
  CHECK(unknown.at_far.largest_px == Approx(known.at_far.largest_px).epsilon(1e-3));
  CHECK_THROWS_AS(import::rectification(cameras, {}), ConfigError);
  CHECK_THROWS_AS(import::rectification(cameras, {geometry::RectifiedField::kFilled, 1.5, 2, 3}),
                  ConfigError);
}
