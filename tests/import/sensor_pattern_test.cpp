// SPDX-License-Identifier: Apache-2.0
#include "jade/import/sensor_pattern.h"

#include "support/catch.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>

#include "import/moving_pattern.h"
#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "support/temp_dir.h"

using namespace jade;

namespace {

constexpr int64_t kPatternWidth = 96, kPatternHeight = 72;

/// Gray frames of a textured plane that moves by so many pixels from one to the next.
std::vector<torch::Tensor> frames_of(size_t count, double step_px) {
  std::vector<torch::Tensor> frames;
  torch::manual_seed(3);
  for (size_t k = 0; k < count; ++k) {
    const double t = double(k);
    const double dx = step_px * t + 3 * step_px * std::sin(0.9 * t);
    const double dy = 2 * step_px * std::sin(0.7 * t) + 0.5 * step_px * t;
    torch::Tensor frame = torch::empty({kPatternHeight, kPatternWidth});
    auto* value = frame.data_ptr<float>();
    for (int64_t i = 0; i < frame.numel(); ++i) {
      value[i] = float(test::pattern_at(0.5 * (double(i % kPatternWidth) - dx),
                                        0.5 * (double(i / kPatternWidth) - dy)));
    }
    frame += 0.005 * torch::randn_like(frame);
    frames.push_back(frame.clamp(0, 1).expand({3, -1, -1}).contiguous());
  }
  return frames;
}

/// Offsets of columns and pixels, [H,W].
torch::Tensor offsets() {
  torch::manual_seed(7);
  return 0.02 * torch::randn({1, kPatternWidth}) +
         0.02 * torch::randn({kPatternHeight, kPatternWidth});
}

/// Two dark spots of 4 px, [H,W]: the part of the light that passes.
torch::Tensor dust() {
  torch::Tensor passed = torch::ones({kPatternHeight, kPatternWidth});
  const torch::Tensor row = torch::arange(kPatternHeight, torch::kFloat32).unsqueeze(1);
  const torch::Tensor column = torch::arange(kPatternWidth, torch::kFloat32).unsqueeze(0);
  for (const auto& [y, x] : {std::pair{20, 30}, std::pair{50, 70}}) {
    const torch::Tensor far = ((row - y).square() + (column - x).square()) / 16;
    passed *= 1 - 0.5 * (-far.square()).exp();
  }
  return passed;
}

double rms(const torch::Tensor& values) { return values.square().mean().sqrt().item<double>(); }

/// How far frames without the pattern are from the true ones, over all frames.
double left_of(const import::SensorPattern& pattern, const std::vector<torch::Tensor>& given,
               const std::vector<torch::Tensor>& truth) {
  import::Capture capture;
  for (const torch::Tensor& image : given) capture.shots.push_back({"a", image, 0, 1000});
  import::remove_sensor_pattern(pattern, capture);
  double sum = 0;
  for (size_t i = 0; i < truth.size(); ++i) {
    sum += std::pow(rms(capture.shots[i].image - truth[i]), 2);
  }
  return std::sqrt(sum / double(truth.size()));
}

}  // namespace

TEST_CASE("sensor pattern: offsets of columns and pixels are found", "[import]") {
  const auto truth = frames_of(24, 6);
  std::vector<torch::Tensor> given;
  for (const torch::Tensor& frame : truth) given.push_back((frame + offsets()).clamp(0, 1));
  const import::SensorPattern found = import::find_sensor_pattern(given);
  CAPTURE(found.said);
  REQUIRE(found.is_found());
  CHECK(left_of(found, given, truth) < 0.6 * left_of({}, given, truth));
}

TEST_CASE("sensor pattern: dust is found", "[import]") {
  const auto truth = frames_of(24, 6);
  std::vector<torch::Tensor> given;
  for (const torch::Tensor& frame : truth) given.push_back(frame * dust());
  const import::SensorPattern found = import::find_sensor_pattern(given);
  CAPTURE(found.said);
  REQUIRE(found.is_found());
  CHECK(left_of(found, given, truth) < 0.5 * left_of({}, given, truth));
}

TEST_CASE("sensor pattern: none on clean frames, of a slow camera, or of few frames", "[import]") {
  for (const double step_px : {0.0, 0.1, 0.5, 6.0}) {
    const import::SensorPattern found = import::find_sensor_pattern(frames_of(24, step_px));
    CAPTURE(step_px, found.said);
    CHECK_FALSE(found.is_found());
  }
  std::vector<torch::Tensor> few = frames_of(7, 6);
  for (torch::Tensor& frame : few) frame = frame + offsets();
  CHECK_FALSE(import::find_sensor_pattern(few).is_found());
}

TEST_CASE("sensor pattern: white stays white", "[import]") {
  import::SensorPattern pattern;
  pattern.scale = torch::full({3, 2, 2}, 1.25f), pattern.offset = torch::full({3, 2, 2}, -0.1f);
  import::Capture capture;
  torch::Tensor image = torch::full({3, 2, 2}, 0.4f);
  image[0][0][0] = 1;
  image[0][0][1] = 0;
  capture.shots.push_back({"a", image, 0, 1000});
  import::remove_sensor_pattern(pattern, capture);
  const torch::Tensor& corrected = capture.shots[0].image;
  CHECK(corrected[0][0][0].item<float>() == 1);
  CHECK(corrected[0][0][1].item<float>() == 0);
  CHECK(corrected[1][1][1].item<float>() == Approx(0.4));
}

TEST_CASE("sensor pattern: kept and loaded", "[import]") {
  const test::TempDir dir;
  import::SensorPattern pattern;
  pattern.said = "none found";
  import::keep_sensor_pattern(dir.path(), pattern);
  CHECK_FALSE(import::load_sensor_pattern(dir.path()).is_found());
  pattern.scale = torch::rand({3, 4, 5}), pattern.offset = torch::rand({3, 4, 5});
  pattern.additive = 0.02, pattern.multiplicative = 0.1, pattern.said = "said";
  import::keep_sensor_pattern(dir.path(), pattern);
  const import::SensorPattern loaded = import::load_sensor_pattern(dir.path());
  CHECK(loaded.scale.equal(pattern.scale));
  CHECK(loaded.offset.equal(pattern.offset));
  CHECK(loaded.additive == 0.02);
  CHECK(loaded.multiplicative == 0.1);
  CHECK(loaded.said == "said");
  write_file(dir / "pattern.json", "{}");
  CHECK_THROWS_AS(import::load_sensor_pattern(dir.path()), DataError);
}
