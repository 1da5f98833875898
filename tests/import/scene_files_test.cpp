// SPDX-License-Identifier: Apache-2.0
#include "jade/import/scene_files.h"

#include "support/catch.h"

#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/data/dataset.h"
#include "support/naming.h"
#include "support/temp_dir.h"

using namespace jade;
using import::Part;

namespace {

constexpr int64_t kPeriodUs = 30000, kExposureUs = 20000;

/// Frames of 20 ms every 30 ms; `blur_px` of each.
import::Capture capture_of(const std::vector<double>& blur_px){import::Capture capture;
capture.source = "table.zip";
capture.format = "folder of frames and events";
std::vector<float> x, y;
std::vector<int64_t> t;
std::vector<int8_t> p;
for (size_t i = 0; i < blur_px.size(); ++i) {
  const int64_t start = kPeriodUs * static_cast<int64_t>(i);
  const auto image = torch::randint(0, 256, {3, 20, 30}).to(torch::kFloat32) / 255;
  capture.shots.push_back({concat("shot", i), image, start, start + kExposureUs, blur_px[i]});
  x.push_back(3), y.push_back(4), t.push_back(start + 100), p.push_back(1);
}
capture.events = events::EventStream::from_lists(x, y, t, p);
return capture;
}  // namespace

/// Three poses per shot on a line, and points in front of them.
import::Reconstruction line_of(const import::Capture& capture){import::Reconstruction found;
found.camera = geometry::Intrinsics::centred(25, 30, 20);
for (size_t i = 0; i < capture.shots.size(); ++i) {
  const import::Shot& shot = capture.shots[i];
  for (const int64_t t : {shot.t_start_us, shot.t_mid_us(), shot.t_end_us}) {
    found.poses.push_back(
        {t, static_cast<int64_t>(i), {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {-1e-6 * double(t), 0, 0}}, 9});
  }
}
found.points = torch::rand({50, 3}, torch::kFloat64) + torch::tensor({-0.5, -0.5, 1.0});
found.colors = torch::randint(0, 256, {50, 3}, torch::kUInt8);
found.point_errors = torch::zeros({50}, torch::kFloat64);
found.seen_by.assign(50, {0, 1, 2});
return found;
}

import::ImportOptions options_with(std::vector<std::string> tests = {}){
    import::ImportOptions options;
options.test.names = std::move(tests);
return options;
}

std::vector<Part> parts(const std::vector<double>& blur_px, const import::TestOptions& options) {
  const import::Capture capture = capture_of(blur_px);
  return import::parts_of(capture, line_of(capture).poses, options);
}

}  // namespace

TEST_CASE("test frames: the sharp ones, where there are any", "[import]") {
  CHECK((parts({5, 0.5, 5, 5}, {}) ==
         std::vector{Part::kTrain, Part::kTest, Part::kTrain, Part::kTrain}));
}

TEST_CASE("test frames: at most a quarter of the frames, the other sharp ones train", "[import]") {
  CHECK((parts({0.5, 5, 0.5, 0.5, 5, 0.5, 0.5, 5}, {}) ==
         std::vector{Part::kTrain, Part::kTrain, Part::kTrain, Part::kTest, Part::kTrain,
                     Part::kTrain, Part::kTest, Part::kTrain}));
  CHECK((parts({0.5, 0.5, 0.5}, {}) == std::vector{Part::kTrain, Part::kTrain, Part::kTest}));
  // Frames without a length cannot be trained on.
  import::Capture capture = capture_of({0, 5, 0, 0.5});
  for (const size_t i : {0, 2}) capture.shots[i].t_end_us = capture.shots[i].t_start_us;
  CHECK((import::parts_of(capture, line_of(capture).poses, {}) ==
         std::vector{Part::kTest, Part::kTrain, Part::kTest, Part::kTrain}));
}

TEST_CASE("test frames: every eighth exposure is held out where all are blurry", "[import]") {
  const std::vector<Part> found = parts(std::vector<double>(17, 5.0), {});
  for (size_t i = 0; i < found.size(); ++i) {
    CHECK((found[i] == (i == 4 || i == 12 ? Part::kHeldOut : Part::kTrain)));
  }
}

TEST_CASE("test frames: named ones, held out where they are blurry", "[import]") {
  import::TestOptions options;
  options.names = {"shot1", "shot2"};
  CHECK((parts({5, 0.5, 5, 0.5}, options) ==
         std::vector{Part::kTrain, Part::kTest, Part::kHeldOut, Part::kTrain}));
  options.names = {"shot9"};
  CHECK_THROWS_NAMING(ConfigError, parts({5, 5, 5, 5}, options), "'shot9'");
}

TEST_CASE("test frames: a shot without a pose is left out, and something must be left to train",
          "[import]") {
  const import::Capture capture = capture_of({5, 5, 5, 5});
  std::vector<import::TimedPose> poses = line_of(capture).poses;
  poses.erase(poses.begin() + 3, poses.begin() + 6);
  CHECK((import::parts_of(capture, poses, {})[1] == Part::kLeftOut));
  import::TestOptions all;
  all.names = {"shot0", "shot1", "shot2", "shot3"};
  CHECK_THROWS_NAMING(DataError, parts({5, 5, 5, 5}, all), "training", "none");
}

TEST_CASE("scene files: the data set loads with poses, points and held-out exposures", "[import]") {
  const test::TempDir dir;
  const import::Capture capture = capture_of({5, 5, 5, 0.5, 5});
  const import::Reconstruction found = line_of(capture);
  const std::string said =
      import::write_scene(dir.path(), capture, found, options_with({"shot2", "shot3"}));
  CHECK_THAT(said, Catch::StartsWith("3 exposures, 1 held out, 1 sharp test view, "));
  data::DatasetOptions options;
  options.path = dir.path();
  const data::Dataset data = data::load_dataset(options);
  REQUIRE(data.train.size() == 3);
  REQUIRE(data.held_out.size() == 1);
  REQUIRE(data.test.size() == 1);
  CHECK(torch::allclose(data.held_out[0].blurry, capture.shots[2].image, 0, 1e-6));
  CHECK(torch::allclose(data.test[0].image, capture.shots[3].image, 0, 1e-6));
  CHECK(data.held_out[0].t_start_us == capture.shots[2].t_start_us);
  CHECK(data.points.size(0) == 50);
  CHECK(torch::allclose(data.points.to(torch::kFloat64), found.points, 0, 1e-6));
  for (const data::Exposure& exposure : data.train) {
    const auto times = geometry::exposure_times(exposure.t_start_us, exposure.t_end_us);
    for (size_t k = 0; k < times.size(); ++k) {
      CHECK(geometry::centre(exposure.poses[k])[0] == Approx(1e-6 * times[k]).margin(1e-7));
    }
  }
  const std::string list = read_file(dir / "frames.csv"), yaml = read_file(dir / "scene.yaml");
  CHECK_THAT(list, Catch::Contains("2,held out,shot2,60000,80000,5\n"));
  CHECK_THAT(list, Catch::Contains("4,test,shot3,"));
  CHECK_THAT(yaml, Catch::Contains("threshold_positive: 0.25"));
}

TEST_CASE("scene files: the mask of a capture is that of the data set, until the next import",
          "[import]") {
  const test::TempDir dir;
  import::Capture capture = capture_of({5, 5, 5, 0.5, 5});
  capture.mask = torch::ones({1, capture.height(), capture.width()}, torch::kBool);
  capture.mask.slice(2, 0, 3).fill_(false);
  import::write_scene(dir.path(), capture, line_of(capture), {});
  data::DatasetOptions options;
  options.path = dir.path();
  CHECK(data::load_dataset(options).train[0].mask.equal(capture.mask));
  import::keep_capture(dir.path(), capture);
  CHECK(import::load_capture(dir.path()).mask.equal(capture.mask));
  capture.mask = torch::Tensor();
  import::write_scene(dir.path(), capture, line_of(capture), {});
  CHECK_FALSE(data::load_dataset(options).train[0].mask.defined());
}

TEST_CASE("scene files: masks of single frames are those of the data set's frames", "[import]") {
  const test::TempDir dir;
  import::Capture capture = capture_of({5, 0.5, 5, 5, 5});
  torch::Tensor& mask = capture.shots[2].mask;
  mask = torch::ones({1, capture.height(), capture.width()}, torch::kBool);
  mask.slice(2, 0, 3).fill_(false);
  import::write_scene(dir.path(), capture, line_of(capture), {});
  data::DatasetOptions options;
  options.path = dir.path();
  const data::Dataset data = data::load_dataset(options);
  CHECK_FALSE(data.train[0].mask.defined());
  CHECK(data.train[1].mask.equal(mask));  // shot 1 is the test view
  import::keep_capture(dir.path(), capture);
  const import::Capture kept = import::load_capture(dir.path());
  CHECK(kept.shots[2].mask.equal(mask));
  CHECK_FALSE(kept.shots[1].mask.defined());
  mask = torch::Tensor();
  import::write_scene(dir.path(), capture, line_of(capture), {});
  CHECK_FALSE(data::load_dataset(options).train[1].mask.defined());
}

TEST_CASE("scene files: a second import leaves nothing of the first", "[import]") {
  const test::TempDir dir;
  import::Capture first = capture_of(std::vector<double>(9, 5.0));
  first.filter = import::ColorFilter::kRggb;
  first.sensor = {20, 30};
  import::write_scene(dir.path(), first, line_of(first), {});
  const import::Capture second = capture_of({5, 0.5, 5, 5});
  import::write_scene(dir.path(), second, line_of(second), {});
  data::DatasetOptions options;
  options.path = dir.path();
  const data::Dataset data = data::load_dataset(options);
  CHECK(data.train.size() == 3);
  CHECK(data.held_out.empty());
  CHECK(data.test.size() == 1);
  CHECK_FALSE(data.event_color.defined());
}

TEST_CASE("scene files: events behind a colour filter keep their colours", "[import]") {
  using import::ColorFilter;
  import::Capture capture = capture_of({5, 5, 5, 5});
  capture.sensor = {20, 30};
  for (const ColorFilter filter :
       {ColorFilter::kRggb, ColorFilter::kBggr, ColorFilter::kGrbg, ColorFilter::kGbrg}) {
    capture.filter = filter;
    for (const int64_t shift : {0, 3}) {
      INFO(word_of(filter) << " " << shift);
      const auto axes = torch::meshgrid({torch::arange(20), torch::arange(30)}, "ij");
      capture.event_map = torch::stack({axes[1] + shift, axes[0] + shift}).to(torch::kFloat32);
      if (shift == 0) capture.event_map = torch::Tensor();
      const test::TempDir dir;
      import::write_scene(dir.path(), capture, line_of(capture), {});
      data::DatasetOptions options;
      options.path = dir.path();
      const torch::Tensor color = data::load_dataset(options).event_color;
      REQUIRE(color.defined());
      for (const auto& [row, column] : {std::pair<int64_t, int64_t>{8, 9}, {11, 6}, {7, 7}}) {
        const int64_t channel = import::channel_of(filter, row - shift, column - shift);
        CHECK(color.select(1, row).select(1, column).nonzero().item<int64_t>() == channel);
      }
    }
  }
}

TEST_CASE("scene files: frames without a pose are named", "[import]") {
  const test::TempDir dir;
  const import::Capture capture = capture_of({5, 5, 5, 5, 5});
  import::Reconstruction found = line_of(capture);
  found.poses.erase(found.poses.begin() + 3, found.poses.begin() + 9);
  const std::string said = import::write_scene(dir.path(), capture, found, {});
  CHECK_THAT(said, test::naming("2 left out", "(shot1, shot2)"));
  CHECK_THAT(said, Catch::StartsWith("3 exposures, "));
  CHECK_THAT(read_file(dir / "frames.csv"), Catch::Contains("\n,left out,shot1,30000,50000,5\n"));
}
