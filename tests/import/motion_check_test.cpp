// SPDX-License-Identifier: Apache-2.0
#include "jade/import/motion_check.h"

#include "support/catch.h"

#include <torch/types.h>

using namespace jade;

namespace {

/// A smooth random texture, [3,H,W].
torch::Tensor texture() {
  torch::manual_seed(4);
  const auto noise = torch::rand({1, 1, 90, 130});
  return torch::avg_pool2d(noise, 3, 1, 1)[0].expand({3, 90, 130}).contiguous();
}

/// A plane at depth 2 that moves by ±6 px during the exposure as the camera goes sideways, and the
/// poses of a camera that moves `share` times as far.
import::PosedExposure sideways(double share){import::PosedExposure e;
e.camera = geometry::Intrinsics::centred(100, 130, 90);
e.sharp = texture();
e.blurry = torch::zeros_like(e.sharp);
for (int k = 0; k < 9; ++k) {
  const double way_px = 1.5 * (k - 4);
  const double weight = (k == 0 || k == 8 ? 0.5 : 1.0) / 8;
  e.blurry += weight * (0.5 * torch::roll(e.sharp, int64_t(std::floor(way_px)), 2) +
                        0.5 * torch::roll(e.sharp, int64_t(std::ceil(way_px)), 2));
  e.poses.push_back({{1, 0, 0, 0, 1, 0, 0, 0, 1}, {share * way_px * 2 / 100, 0, 0}});
}
for (double x = -0.8; x < 0.9; x += 0.2) {
  for (double y = -0.5; y < 0.6; y += 0.2) e.points.push_back({x, y, 2});
}
return e;
}  // namespace

}  // namespace

TEST_CASE("motion: the longest shift between images, to either side", "[import]") {
  const auto image = texture();
  CHECK(import::largest_shift_px({image, image}) == Approx(0).margin(0.1));
  CHECK(import::largest_shift_px({image, torch::roll(image, {-3, 7}, {1, 2})}) ==
        Approx(std::hypot(3, 7)));
}

TEST_CASE("blur check: right poses explain the blur, poses that stand still or turn back do not",
          "[import]") {
  const double right = import::explained_blur({sideways(1)});
  CHECK(right > 0.9);
  CHECK(import::explained_blur({sideways(0)}) == Approx(0).margin(1e-6));
  CHECK(import::explained_blur({sideways(0.5)}) < right - 0.1);
  CHECK(import::explained_blur({sideways(2.5)}) < right - 0.1);
  import::PosedExposure across = sideways(1);
  for (geometry::Pose& pose : across.poses) std::swap(pose.translation[0], pose.translation[1]);
  CHECK(import::explained_blur({across}) < -1);
  import::PosedExposure without = sideways(1);
  without.points.clear();
  CHECK(import::explained_blur({without}) == 0);
}
