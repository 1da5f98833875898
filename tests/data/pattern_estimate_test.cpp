// SPDX-License-Identifier: Apache-2.0
#include "jade/data/pattern_estimate.h"

#include "support/catch.h"

#include <ATen/CPUGeneratorImpl.h>
#include <cmath>
#include <torch/types.h>

namespace jade::data {
namespace {

constexpr int64_t kFrame = 64;
constexpr int64_t kWorld = 160;
constexpr double kFocal = 60, kDepth = 2;

/// Frames of a flat picture seen from places on its plane, px, each with `pattern`.
Dataset frames_over_a_picture(const std::vector<std::array<int64_t, 2>>& places,
                              const torch::Tensor& pattern) {
  auto generator = at::make_generator<at::CPUGeneratorImpl>(7);
  const torch::Tensor noise = at::rand({1, 1, kWorld, kWorld}, generator, torch::kFloat32);
  const torch::Tensor picture = at::avg_pool2d(noise, 5, 1)[0] * 2 - 0.5;
  Dataset dataset;
  dataset.near = kDepth, dataset.far = kDepth;
  for (const auto& [x, y] : places) {
    Exposure frame;
    frame.camera = geometry::Intrinsics::centred(kFocal, kFrame, kFrame);
    const auto cut = picture.slice(1, 40 + y, 40 + y + kFrame).slice(2, 40 + x, 40 + x + kFrame);
    frame.blurry = (cut + pattern).expand({3, kFrame, kFrame}).contiguous();
    for (geometry::Pose& pose : frame.poses) {
      pose.translation = {-double(x) * kDepth / kFocal, -double(y) * kDepth / kFocal, 0};
    }
    dataset.train.push_back(frame);
  }
  return dataset;
}

const std::vector<std::array<int64_t, 2>> kAround{{0, 0},   {20, 4},   {-12, 18}, {5, -22},
                                                  {30, 25}, {-30, 12}, {14, 36},  {-21, -30}};
const std::vector<std::array<int64_t, 2>> kOnALine{{-36, -36}, {-24, -24}, {-12, -12},
                                                   {0, 0},     {12, 12},   {24, 24}};

torch::Tensor pixels(double deviation) {
  auto generator = at::make_generator<at::CPUGeneratorImpl>(3);
  return deviation * at::randn({1, kFrame, kFrame}, generator, torch::kFloat32);
}

TEST_CASE("pattern estimate: finds the strength of pixels, and of columns", "[data]") {
  // The mean of 3x3 pixels removes 1/9 of the variance of pixels and 1/3 of that of columns.
  const double found = estimate_pattern(frames_over_a_picture(kAround, pixels(0.02))).strength;
  CHECK(found == Approx(0.02 * std::sqrt(8.0 / 9)).epsilon(0.1));
  const torch::Tensor columns = pixels(0.02).slice(1, 0, 1).expand({1, kFrame, kFrame});
  const auto of_columns = estimate_pattern(frames_over_a_picture(kAround, columns));
  CHECK(of_columns.strength == Approx(0.02 * std::sqrt(2.0 / 3)).epsilon(0.25));
  CHECK(of_columns.is_worth_learning());
}

TEST_CASE("pattern estimate: a scene that moves in two directions is none", "[data]") {
  const auto found = estimate_pattern(frames_over_a_picture(kAround, torch::zeros({1})));
  CHECK(found.pairs == 28);
  CHECK(found.sideways_px > 15);
  CHECK(found.strength < 0.004);
  CHECK_FALSE(found.is_worth_learning());
}

TEST_CASE("pattern estimate: a camera on a line or at rest cannot separate it from the scene",
          "[data]") {
  const auto slid = estimate_pattern(frames_over_a_picture(kOnALine, pixels(0.02)));
  CHECK(slid.pairs == 15);
  CHECK(slid.sideways_px < 0.01);
  CHECK_FALSE(slid.is_worth_learning());
  const auto resting =
      estimate_pattern(frames_over_a_picture({{0, 0}, {3, 4}, {-2, 1}}, pixels(0.02)));
  CHECK(resting.pairs == 0);
  CHECK_FALSE(resting.is_worth_learning());
}

TEST_CASE("pattern estimate: pixels under a mask and frames of another size do not count",
          "[data]") {
  Dataset dataset = frames_over_a_picture(kAround, pixels(0.02));
  for (Exposure& frame : dataset.train) {
    frame.mask = torch::zeros({1, kFrame, kFrame}, torch::kBool);
  }
  CHECK(estimate_pattern(dataset).strength == 0);
  dataset = frames_over_a_picture(kAround, pixels(0.02));
  dataset.train[3].blurry = torch::zeros({3, 8, 8});
  CHECK(estimate_pattern(dataset).pairs == 21);
}

TEST_CASE("pattern estimate: the border of a mask is no pattern, and hides none of one", "[data]") {
  const auto masked = [](const torch::Tensor& pattern) {
    Dataset dataset = frames_over_a_picture(kAround, pattern);
    for (Exposure& frame : dataset.train) {
      frame.mask = torch::ones({1, kFrame, kFrame}, torch::kBool);
      frame.mask.slice(1, 0, kFrame / 2).fill_(false);
      frame.blurry = frame.blurry * frame.mask;
    }
    return estimate_pattern(dataset).strength;
  };
  CHECK(masked(torch::zeros({1})) < 0.004);
  CHECK(masked(pixels(0.02)) == Approx(0.02 * std::sqrt(8.0 / 9)).epsilon(0.1));
}

}  // namespace
}  // namespace jade::data
