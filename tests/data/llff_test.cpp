// SPDX-License-Identifier: Apache-2.0
#include "jade/data/llff.h"

#include "support/catch.h"

#include <torch/types.h>

#include "data/tiny_recording.h"
#include "jade/core/error.h"
#include "support/naming.h"

namespace jade::data {
namespace {

TEST_CASE("llff: columns down, right, backwards become right, down, forward", "[data]") {
  // A camera at (1,2,3) whose axes right, down, forward are the world's y, z, x.
  const torch::Tensor row = torch::tensor({0., 0., -1., 1., 100.,  //
                                           0., 1., 0., 2., 200.,   //
                                           1., 0., 0., 3., 50.,    //
                                           0.5, 9.},
                                          torch::kFloat64);
  const std::vector<LlffView> views = parse_llff(row.unsqueeze(0), "p.npy");
  REQUIRE(views.size() == 1);
  const geometry::Pose& pose = views[0].camera_from_world;
  const auto ahead = geometry::transform(pose, {4, 2, 3});
  CHECK(ahead[2] == Approx(3));
  CHECK(ahead[0] == Approx(0).margin(1e-12));
  CHECK(geometry::transform(pose, {1, 3, 3})[0] == Approx(1));
  CHECK(geometry::transform(pose, {1, 2, 4})[1] == Approx(1));
  CHECK(views[0].height == 100);
  CHECK(views[0].width == 200);
  CHECK(views[0].focal_px == 50);
  CHECK(views[0].near == 0.5);
  CHECK(views[0].far == 9);
}

TEST_CASE("llff: rows of views parse to the same views", "[data]") {
  std::vector<LlffView> views;
  for (int i = 0; i < 5; ++i) views.push_back({test::steady_pose(3e5 * i), 10, 20, 30, 0.1 + i, 9});
  const std::vector<LlffView> back = parse_llff(llff_rows(views), "p.npy");
  REQUIRE(back.size() == 5);
  for (size_t i = 0; i < 5; ++i) {
    CHECK(test::pose_distance(back[i].camera_from_world, views[i].camera_from_world) < 1e-12);
    CHECK(back[i].near == views[i].near);
  }
}

TEST_CASE("llff: other shapes, reflections and infinite values are data errors", "[data]") {
  const torch::Tensor good = llff_rows({{{}, 10, 20, 30, 1, 2}});
  CHECK_NOTHROW(parse_llff(good, "p.npy"));
  CHECK_THROWS_AS(parse_llff(good.slice(1, 0, 15), "p.npy"), DataError);
  CHECK_THROWS_AS(parse_llff(good[0], "p.npy"), DataError);
  torch::Tensor mirrored = good.clone();
  for (int axis = 0; axis < 3; ++axis) mirrored[0][5 * axis] *= -1;
  CHECK_THROWS_NAMING(DataError, parse_llff(mirrored, "p.npy"), "row 0", "reflection");
  torch::Tensor skewed = good.clone();
  skewed[0][1] += 1;
  CHECK_THROWS_NAMING(DataError, parse_llff(skewed, "p.npy"), "rotation");
  torch::Tensor infinite = good.clone();
  infinite[0][16] = INFINITY;
  CHECK_THROWS_WITH(parse_llff(infinite, "p.npy"), Catch::Contains("row 0 column 16"));
}

}  // namespace
}  // namespace jade::data
