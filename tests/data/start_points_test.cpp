// SPDX-License-Identifier: Apache-2.0
#include "jade/data/start_points.h"

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

#include "jade/data/frames.h"
#include "support/naming.h"

namespace jade::data {
namespace {

using geometry::Vector3;

TEST_CASE("start points: those behind the cameras are reported with the axes that would see them",
          "[data]") {
  Dataset data;
  data.train.resize(4);
  data.kind = DatasetKind::kColmap;
  torch::manual_seed(1);
  data.points = torch::rand({200, 3}) - 0.5;
  for (size_t i = 0; i < 4; ++i) {
    data.train[i].camera = geometry::Intrinsics::centred(50, 64, 48);
    data.train[i].poses.fill(
        {geometry::Matrix3{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0.1 * double(i), 0, 3}});
  }
  const auto told = [&] {
    std::vector<std::string> lines;
    Dataset copy = data;
    check_points(Warnings(&lines), copy);
    return lines.empty() ? "" : lines[0];
  };
  CHECK(told().empty());
  // One camera that sees the points is enough to accept the axes.
  const auto turn = [&](size_t i) {
    data.train[i].poses.fill({geometry::Matrix3{1, 0, 0, 0, -1, 0, 0, 0, -1}, {0, 0, -3}});
  };
  for (const size_t i : {0, 1, 2}) turn(i);
  CHECK(told().empty());
  turn(3);
  CHECK_THAT(told(), Catch::Contains("100 %") && Catch::Contains("OpenGL axes") &&
                         Catch::Contains("forwards); the scene starts without them"));
  data.kind = DatasetKind::kTransforms;
  CHECK_THAT(told(), Catch::Contains("OpenCV axes"));
  for (Exposure& exposure : data.train)
    exposure.poses.fill({exposure.poses[0].rotation, {40, 0, -3}});
  CHECK_THAT(told(), !Catch::Contains("OpenCV axes") && Catch::Contains("one scene"));
}

/// Twelve cameras on an arc of radius 3 that look at points around the origin; or cameras in a row
/// with points 2 to 8 ahead.
Dataset scene(bool row) {
  Dataset data;
  data.kind = DatasetKind::kColmap;
  data.train.resize(12);
  torch::manual_seed(2);
  data.points = torch::rand({300, 3}) * 2 - 1;
  if (row) data.points = data.points * torch::tensor({2.0, 1.5, 3.0}) + torch::tensor({0., 0., 5.});
  data.point_colors = torch::rand({300, 3});
  for (size_t i = 0; i < 12; ++i) {
    const double angle = 0.2 * double(i);
    const Vector3 eye = row ? Vector3{0.1 * double(i), 0, 0}
                            : Vector3{3 * std::sin(angle), -0.5, -3 * std::cos(angle)};
    data.train[i].camera = geometry::Intrinsics::centred(50, 64, 48);
    data.train[i].poses.fill(
        geometry::look_at(eye, row ? Vector3{eye[0], 0, 9} : Vector3{0, 0, 0}, {0, -1, 0}));
  }
  return data;
}

std::string told(Dataset& data) {
  std::vector<std::string> lines;
  check_points(Warnings(&lines), data);
  return lines.empty() ? "" : lines[0];
}

TEST_CASE("start points: those that are not finite or absurdly far are left out", "[data]") {
  torch::manual_seed(3);
  const torch::Tensor good = torch::rand({100, 3}, torch::kFloat64);
  const auto left = [&](std::vector<double> bad) {
    torch::Tensor points = torch::cat({good, torch::tensor(bad, torch::kFloat64).reshape({1, 3})});
    torch::Tensor colors = torch::zeros({101, 3}, torch::kUInt8);
    std::vector<std::string> lines;
    drop_absurd_points("points.npz", Warnings(&lines), points, colors);
    CHECK(points.size(0) == colors.size(0));
    CHECK(lines.size() == size_t(101 - points.size(0)));
    if (!lines.empty()) CHECK_THAT(lines[0], test::naming("points.npz", "1 of 101"));
    return points.size(0);
  };
  CHECK(left({1e30, 0, 0}) == 100);
  CHECK(left({0, std::nan(""), 0}) == 100);
  CHECK(left({0, 0, -INFINITY}) == 100);
  CHECK(left({1000, 0, 0}) == 101);
}

TEST_CASE("start points: those of another unit are reported with the share seen", "[data]") {
  for (const bool row : {false, true}) {
    Dataset good = scene(row), small = scene(row), large = scene(row);
    CHECK(told(good).empty());
    small.points = small.points / 1000;
    large.points = large.points * 1000;
    CHECK_THAT(told(small), test::naming("unit", "%"));
    CHECK_THAT(told(large), test::naming("unit"));
  }
}

TEST_CASE("start points: those in no picture are reported and not used", "[data]") {
  Dataset swapped = scene(true);
  swapped.points = swapped.points.index_select(1, torch::tensor({0, 2, 1}));
  CHECK_THAT(told(swapped), test::naming("axes", "%"));

  Dataset elsewhere = scene(true);
  elsewhere.points = elsewhere.points + torch::tensor({0., 400., 0.});
  std::vector<geometry::Pose> poses;
  for (const Exposure& exposure : elsewhere.train) poses.push_back(exposure.poses[0]);
  CHECK_THAT(told(elsewhere), test::naming("0 %"));
  CHECK_FALSE(elsewhere.points.defined());
  CHECK_FALSE(elsewhere.point_colors.defined());
  CHECK(elsewhere.far == Approx(depth_bounds({}, poses).far));
}

TEST_CASE("start points: a few that no camera sees are no fault", "[data]") {
  Dataset data = scene(false);
  data.points = torch::cat({data.points, data.points + torch::tensor({0., 50., 0.})});
  data.point_colors = torch::cat({data.point_colors, data.point_colors});
  CHECK(told(data).empty());
  CHECK(data.points.size(0) == 600);
}

}  // namespace
}  // namespace jade::data
