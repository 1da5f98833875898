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

/// A plane at depth 2 that moves by ±6 px during the exposure of a sideways-moving camera, and the
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

namespace {

/// Frames of a texture that moves by `step_px` between frames, with fresh noise, and with patterns
/// fixed to the sensor: noise of its pixels, rows and columns, vignetting and dust.
std::vector<torch::Tensor> frames_of_a_bad_sensor(int64_t step_px) {
  const torch::Tensor scene = 0.1 + 0.3 * texture();
  torch::Tensor pattern = 0.08 * torch::randn({1, 90, 130}) + 0.04 * torch::randn({1, 90, 1}) +
                          0.04 * torch::randn({1, 1, 130});
  const torch::Tensor x = torch::linspace(-1, 1, 130), y = torch::linspace(-1, 1, 90).unsqueeze(1);
  torch::Tensor light = 1 - 0.4 * (x.square() + y.square());
  for (int64_t k = 0; k < 8; ++k) {
    light.slice(0, 11 * k, 11 * k + 5).slice(1, 37 * k % 120, 37 * k % 120 + 5) *= 0.4;
  }
  std::vector<torch::Tensor> frames;
  for (int64_t i = 0; i < 10; ++i) {
    const torch::Tensor noise = 0.02 * torch::randn({1, 90, 130});
    frames.push_back(torch::roll(scene, step_px * i, 2) * light + pattern + noise);
  }
  return frames;
}

}  // namespace

TEST_CASE("motion: the longest shift between images, to either side", "[import]") {
  const auto image = texture();
  const import::FrameMotion still = import::frame_motion({image, image, image});
  CHECK(still.shift_px == 0);
  CHECK(still.measured == 0);
  CHECK(still.compared == 3);
  CHECK(import::frame_motion({image, torch::roll(image, {-3, 7}, {1, 2})}).shift_px ==
        Approx(std::hypot(3, 7)));
}

TEST_CASE("motion: what is fixed to the sensor neither hides motion nor makes it", "[import]") {
  const import::FrameMotion moving = import::frame_motion(frames_of_a_bad_sensor(2));
  CHECK(moving.shift_px == Approx(18));  // of the first and the last
  CHECK(moving.measured > moving.compared / 2);
  const import::FrameMotion still = import::frame_motion(frames_of_a_bad_sensor(0));
  CHECK(still.shift_px == 0);
  // A flickering lamp is not motion either.
  auto flickering = frames_of_a_bad_sensor(0);
  for (size_t i = 0; i < flickering.size(); ++i) flickering[i] *= 1 + 0.1 * double(i % 3);
  CHECK(import::frame_motion(flickering).shift_px == 0);
}

TEST_CASE("blur check: right poses explain the blur, static or reversed poses do not", "[import]") {
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
  CHECK(import::posed_blur_px({without}) == 0);
  CHECK(import::posed_blur_px({sideways(1)}) == Approx(12));
  CHECK(import::posed_blur_px({sideways(0.5), across}) == Approx(12));
}
