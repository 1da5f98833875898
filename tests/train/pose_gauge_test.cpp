// SPDX-License-Identifier: Apache-2.0
#include "jade/train/pose_gauge.h"

#include "support/catch.h"

#include <torch/types.h>

#include "jade/geometry/se3.h"
#include "support/se3_log.h"

using namespace jade;

namespace {

constexpr double kDepth = 3;

/// Five exposures of two control poses with varied orientations.
torch::Tensor control_poses() {
  torch::manual_seed(8);
  return geometry::se3_exp(0.7 * torch::randn({5, 2, 6}, torch::kFloat64));
}

/// The twists that move the cameras by `world`, scaled by `scale` about the origin.
torch::Tensor shared_motion(const torch::Tensor& control, const torch::Tensor& world,
                            double scale) {
  torch::Tensor moved = geometry::se3_exp(world).matmul(control);
  moved.narrow(-2, 0, 3).select(-1, 3).mul_(scale);
  return test::se3_log(geometry::se3_inverse(control).matmul(moved));
}

double size_of(const torch::Tensor& t) { return t.abs().max().item<double>(); }

}  // namespace

TEST_CASE("pose gauge: a motion and scale of the whole world goes, to first order", "[train]") {
  const torch::Tensor control = control_poses();
  const train::PoseGauge gauge = train::pose_gauge(control, kDepth);
  CHECK(gauge.read.size(0) == 7);
  for (const double size : {1e-4, 1e-3}) {
    torch::Tensor twists = shared_motion(
        control, size * torch::tensor({0.3, -1.0, 0.5, 0.8, -0.4, 0.6}, torch::kFloat64), 1 + size);
    const double before = size_of(twists);
    train::remove_gauge(gauge, twists);
    CHECK(before > 0.5 * size);
    CHECK(size_of(twists) < 10 * size * size);
  }
}

TEST_CASE("pose gauge: what cameras do apart from each other stays", "[train]") {
  const torch::Tensor control = control_poses();
  const train::PoseGauge gauge = train::pose_gauge(control, kDepth);
  torch::Tensor relative = 0.01 * torch::randn({5, 2, 6}, torch::kFloat64);
  train::remove_gauge(gauge, relative);
  const torch::Tensor once = relative.clone();
  CHECK(size_of(once) > 0.005);
  train::remove_gauge(gauge, relative);
  CHECK(size_of(relative - once) < 1e-15);
  torch::Tensor both = once + shared_motion(control, torch::full({6}, 1e-5, torch::kFloat64), 1);
  train::remove_gauge(gauge, both);
  CHECK(size_of(both - once) < 1e-8);
}

TEST_CASE("pose gauge: cameras that stand in one place have no scale", "[train]") {
  torch::Tensor control = control_poses();
  control.narrow(-2, 0, 3).select(-1, 3).zero_();
  CHECK(train::pose_gauge(control, kDepth).read.size(0) == 6);
}
