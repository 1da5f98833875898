// SPDX-License-Identifier: Apache-2.0
#include "jade/import/vignetting.h"

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/imaging/image_io.h"
#include "jade/world/noise.h"
#include "support/temp_dir.h"

using namespace jade;

namespace {

/// Tracks of points that cross the picture, each up to eight shots long, with the errors of latents
/// and a few samples of other points.
std::vector<import::BrightnessSample> tracks(double corner, int64_t points,
                                             double trend_per_shot = 0) {
  world::Draw draw(5);
  std::vector<import::BrightnessSample> samples;
  for (int64_t k = 0; k < points; ++k) {
    const double own = -1.2 + 0.6 * draw.normal();
    double x = 2 * draw.uniform() - 1, y = 2 * draw.uniform() - 1;
    const double dx = 0.1 * draw.normal(), dy = 0.1 * draw.normal();
    const auto first = int64_t(20 * draw.uniform());
    for (int64_t j = first; j < first + 8; ++j, x += dx, y += dy) {
      if (std::abs(x) > 1 || std::abs(y) > 1) break;
      const double r = std::sqrt((x * x + y * y) / 2);
      double log = own + 0.1 * std::sin(double(j)) + trend_per_shot * double(j) +
                   std::log(1 - (1 - corner) * r * r) + 0.08 * draw.normal();
      if (draw.uniform() < 0.05) log += 1.5 * draw.normal();
      samples.push_back({k, j, r, log});
    }
  }
  return samples;
}

}  // namespace

TEST_CASE("vignetting: the falloff of tracks is found", "[import]") {
  for (const double corner : {0.5, 0.8, 0.93}) {
    const import::Vignetting found = import::fit_vignetting(tracks(corner, 2000, 0.02));
    CAPTURE(corner, found.said, found.error);
    REQUIRE(found.is_found());
    CHECK(found.reach > 0.9);
    CHECK(found.reach <= 1);
    for (const double r : {0.3, 0.6, 0.9}) {
      CHECK(found.at(r) == Approx(1 - (1 - corner) * r * r).margin(0.015));
    }
    CHECK(found.at(2) == found.at(found.reach));
    CHECK(found.at(0) == 1);
  }
}

TEST_CASE("vignetting: none where tracks show none", "[import]") {
  CHECK_FALSE(import::fit_vignetting(tracks(1, 2000)).is_found());
  // Less than noise, brighter corners, and too few samples.
  CHECK_FALSE(import::fit_vignetting(tracks(0.985, 2000)).is_found());
  CHECK_FALSE(import::fit_vignetting(tracks(1.2, 2000)).is_found());
  CHECK_FALSE(import::fit_vignetting(tracks(0.5, 30)).is_found());
  CHECK_FALSE(import::fit_vignetting({}).is_found());
  // Static points are inconclusive: their own brightness may explain everything.
  std::vector<import::BrightnessSample> still;
  for (int64_t k = 0; k < 400; ++k) {
    const double r = double(k) / 400;
    for (int64_t j = 0; j < 5; ++j) still.push_back({k, j, r, std::log(1 - 0.5 * r * r)});
  }
  CHECK_FALSE(import::fit_vignetting(still).is_found());
}

TEST_CASE("vignetting: frames are divided, and white stays white", "[import]") {
  import::Vignetting half;
  half.terms = {std::log(0.5), 0, 0}, half.reach = 0.9;
  import::Capture capture;
  const torch::Tensor map = import::vignetting_map(half, 30, 40);
  const double corner = std::hypot(19.5, 14.5) / 25;
  CHECK(corner > half.reach);
  CHECK(map[0][0].item<double>() == Approx(half.at(corner)));
  CHECK(map[0][0].item<double>() == Approx(std::pow(0.5, 0.81)));
  CHECK(map[14][19].item<double>() == Approx(half.at(std::hypot(0.5, 0.5) / 25)));
  CHECK(map.equal(map.flip({0, 1})));
  torch::Tensor image = (0.8 * map).to(torch::kFloat32).expand({3, 30, 40}).clone();
  image[1][0][0] = 1;
  capture.shots.push_back({"a", image, 0, 1000});
  import::remove_vignetting(half, capture);
  const torch::Tensor& corrected = capture.shots[0].image;
  CHECK(corrected[1][0][0].item<float>() == 1);
  CHECK(corrected[0].sub(0.8).abs().max().item<double>() < 1e-6);
  const torch::Tensor before = corrected.clone();
  import::remove_vignetting({}, capture);
  CHECK(capture.shots[0].image.equal(before));
}

TEST_CASE("vignetting: brightness is sampled where the points are seen", "[import]") {
  const test::TempDir dir;
  make_writable_folder(dir / "images");
  // Brightness is 0.2 at the left and grows by 0.01 per pixel of the shots; the image is twice as
  // large.
  const torch::Tensor row = 0.2 + 0.01 * (0.5 * (torch::arange(80) + 0.5));
  imaging::write_image(dir / "images/a.png", row.expand({3, 60, 80}).contiguous(), {16, 95});
  import::Capture capture;
  capture.shots.push_back({"a", torch::zeros({3, 30, 40}), 0, 100});
  import::Reconstruction found;
  found.camera = geometry::Intrinsics::centred(40, 40, 30);
  found.poses = {{50, 0, {}, 4}};
  // In the middle, right of it by 10 px, behind the camera, and outside.
  found.points = torch::tensor(
      {{0.0, 0.0, 2.0}, {0.5, 0.0, 2.0}, {0.0, 0.0, -2.0}, {2.0, 0.0, 2.0}}, torch::kFloat64);
  found.seen_by = {{0}, {0}, {0}, {0}};
  const std::vector<import::LatentImage> images{{"a.png", 0, 50}};
  auto samples = import::sample_brightness(capture, found, images, dir.path());
  REQUIRE(samples.size() == 2);
  CHECK(samples[0].point == 0);
  CHECK(samples[0].radius == Approx(0).margin(1e-12));
  CHECK(std::exp(samples[0].log_brightness) == Approx(0.4).margin(2e-3));
  CHECK(samples[1].point == 1);
  CHECK(samples[1].radius == Approx(10.0 / 25));
  CHECK(std::exp(samples[1].log_brightness) == Approx(0.5).margin(2e-3));
  // A masked pixel does not count.
  capture.mask = torch::ones({1, 30, 40}, torch::kBool);
  capture.mask[0][15][30] = false;
  samples = import::sample_brightness(capture, found, images, dir.path());
  REQUIRE(samples.size() == 1);
  CHECK(samples[0].point == 0);
}

TEST_CASE("vignetting: kept and loaded", "[import]") {
  const test::TempDir dir;
  import::Vignetting found{{-0.3, 0.1, -0.2}, 0.97, 0.004, 1234, "said"};
  import::keep_vignetting(dir.path(), found);
  const import::Vignetting loaded = import::load_vignetting(dir.path());
  CHECK(loaded.terms == found.terms);
  CHECK(loaded.reach == found.reach);
  CHECK(loaded.error == found.error);
  CHECK(loaded.samples == found.samples);
  CHECK(loaded.said == found.said);
  write_file(dir / "vignetting.json", "{}");
  CHECK_THROWS_AS(import::load_vignetting(dir.path()), DataError);
}
