// SPDX-License-Identifier: Apache-2.0
#include "jade/data/evdeblur.h"

#include "support/catch.h"

#include <filesystem>
#include <torch/types.h>
#include <utility>

#include "data/tiny_recording.h"
#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/data/evdeblur_writer.h"
#include "jade/io/hdf5.h"
#include "jade/io/npy.h"
#include "support/naming.h"
#include "support/temp_dir.h"

namespace jade::data {
namespace {

namespace fs = std::filesystem;
using test::mentions;
using test::pose_distance;

Dataset load(const fs::path& folder, std::vector<std::string>* warnings = nullptr) {
  DatasetOptions options;
  options.path = folder;
  return load_dataset(options, warnings);
}

TEST_CASE("evdeblur: writing then loading gives back the same exposures", "[data]") {
  const test::TempDir folder;
  const EvDeblurContent content = test::tiny_content();
  write_evdeblur(folder / "scene", content);
  std::vector<std::string> warnings;
  const Dataset data = load(folder / "scene", &warnings);
  CHECK(warnings.empty());
  CHECK(data.kind == DatasetKind::kEvDeblur);
  CHECK(data.name == "scene");
  CHECK(data.near == 0.5);
  CHECK(data.far == 4);
  REQUIRE(data.train.size() == 4);
  for (size_t i = 0; i < 4; ++i) {
    const Exposure& expected = content.train[i];
    const Exposure& found = data.train[i];
    CHECK(found.name == "0" + std::to_string(i));
    CHECK(test::same_image(found.blurry, expected.blurry));
    CHECK(found.t_start_us == expected.t_start_us);
    CHECK(found.t_end_us == expected.t_end_us);
    CHECK(found.camera == expected.camera);
    CHECK(found.events.size() == 80);
    for (size_t k = 0; k < 9; ++k) CHECK(pose_distance(found.poses[k], expected.poses[k]) < 1e-6);
  }
  REQUIRE(data.test.size() == 2);
  for (size_t i = 0; i < 2; ++i) {
    CHECK(test::same_image(data.test[i].image, content.test[i].image));
    CHECK(data.test[i].t_us == content.test[i].t_us);
    CHECK(pose_distance(data.test[i].pose, content.test[i].pose) < 1e-12);
  }
  CHECK(torch::equal(data.events.x(), content.events.x()));
  CHECK(torch::equal(data.events.t_us(), content.events.t_us()));
  CHECK(torch::equal(data.events.polarity(), content.events.polarity()));
}

TEST_CASE("evdeblur: gains of frames are restored, and broken ones are named", "[data]") {
  const test::TempDir folder;
  EvDeblurContent content = test::tiny_content();
  write_evdeblur(folder / "scene", content);
  CHECK_FALSE(fs::exists(folder / "scene/gains.csv"));
  CHECK(load(folder / "scene").train[1].gain == 1);
  content.train[1].gain = 0.8;
  content.test[0].gain = 1.25;
  write_evdeblur(folder / "scene", content);
  const Dataset data = load(folder / "scene");
  CHECK(data.train[0].gain == 1);
  CHECK(data.train[1].gain == 0.8);
  CHECK(data.test[0].gain == 1.25);
  for (const char* bad : {"01,0", "01,nan", "01", "17,1"}) {
    folder.write("scene/gains.csv", std::string("name,gain\n") + bad + "\n");
    CHECK_THROWS_WITH(load(folder / "scene"), Catch::Contains("gains.csv"));
  }
}

TEST_CASE("evdeblur: gains without a header line count from the first line on", "[data]") {
  const test::TempDir folder;
  write_evdeblur(folder / "scene", test::tiny_content());
  const std::string name = load(folder / "scene").train[0].name;
  folder.write("scene/gains.csv", name + ",1.9\r\n\r\n");
  CHECK(load(folder / "scene").train[0].gain == 1.9);
  folder.write("scene/gains.csv", name + ";1.9\n");
  CHECK_THROWS_WITH(load(folder / "scene"), Catch::Contains("gains.csv:1"));
}

TEST_CASE("evdeblur: frames without a gain are named", "[data]") {
  const test::TempDir folder;
  write_evdeblur(folder / "scene", test::tiny_content());
  std::vector<std::string> warnings;
  folder.write("scene/gains.csv", "name,gain\n00,1.5\n00,0.5\n");
  CHECK_THROWS_WITH(load(folder / "scene"),
                    Catch::Contains("gains.csv:3") && Catch::Contains("again"));
  folder.write("scene/gains.csv", "\xEF\xBB\xBFname,gain\r\n00,1.5\r\n02,1.2\r\n");
  CHECK(load(folder / "scene", &warnings).train[0].gain == 1.5);
  CHECK(mentions(warnings, "gains.csv: expected a gain for each frame, found none for 01, 03, 04"));
}

TEST_CASE("evdeblur: frames go by their numbers, with a warning where text would not", "[data]") {
  const test::TempDir folder;
  const fs::path images = folder / "scene/images_1";
  write_evdeblur(folder / "scene", test::tiny_content());
  const Dataset padded = load(folder / "scene");
  fs::rename(images / "04.png", images / "9.png");
  fs::rename(images / "05.png", images / "10.png");
  std::vector<std::string> warnings;
  const Dataset data = load(folder / "scene", &warnings);
  CHECK(data.test[0].name == "9");
  CHECK(torch::equal(data.test[1].image, padded.test[1].image));
  CHECK(mentions(warnings, "names are not padded with zeros"));
}

TEST_CASE("evdeblur: a sharp view belongs to the exposure in whose middle it was taken", "[data]") {
  const test::TempDir folder;
  write_evdeblur(folder / "scene", test::tiny_content());
  const Dataset data = load(folder / "scene");
  CHECK(exposure_of(data, data.test[0]) == 1);
  CHECK(exposure_of(data, data.test[1]) == -1);
}

TEST_CASE("evdeblur: a view is of mid-exposure up to a sixteenth of the exposure from its middle",
          "[data]") {
  const test::TempDir folder;
  write_evdeblur(folder / "scene", test::tiny_content());
  const Dataset data = load(folder / "scene");
  const int64_t middle = data.train[1].t_start_us + test::kExposureUs / 2;
  const int64_t reach = test::kExposureUs / 16;
  SharpView view = data.test[0];
  for (const auto& [t_us, found] : {std::pair{middle - reach - 1, -1},
                                    {middle - reach, 1},
                                    {middle + reach, 1},
                                    {middle + reach + 1, -1}}) {
    INFO(t_us);
    view.t_us = t_us;
    CHECK(exposure_of(data, view) == found);
  }
}

TEST_CASE("evdeblur: a sharp view is seen when its time lies in an exposure, ends included",
          "[data]") {
  const test::TempDir folder;
  write_evdeblur(folder / "scene", test::tiny_content());
  const Dataset data = load(folder / "scene");
  CHECK(data.test[0].seen == true);
  CHECK(data.test[1].seen == false);
  SharpView view = data.test[1];
  const Exposure& second = data.train[1];
  for (const auto& [t_us, seen] : {std::pair{second.t_start_us - 1, false},
                                   {second.t_start_us, true},
                                   {second.t_start_us + 1000, true},
                                   {second.t_end_us, true},
                                   {second.t_end_us + 1, false}}) {
    INFO(t_us);
    view.t_us = t_us;
    CHECK(is_seen(data, view) == seen);
    // The time decides, not the pose, because learned poses move.
    view.pose = second.poses[0];
    CHECK(is_seen(data, view) == seen);
  }
}

TEST_CASE("evdeblur: sharp frames between blurry ones are the test views", "[data]") {
  const test::TempDir folder;
  EvDeblurContent content = test::tiny_content();
  write_evdeblur(folder / "scene", content);
  // The first and fifth frames are sharp, as with every fourth frame.
  const torch::Tensor start = torch::tensor({5000, 10000, 30000, 50000, 62000, 70000});
  const torch::Tensor length = torch::tensor({0, 8000, 8000, 8000, 0, 8000});
  io::write_npz(folder / "scene/images_1/timestamps.npz",
                {{"timestamps_start", start}, {"timestamps_end", start + length}});
  std::vector<std::string> warnings;
  const Dataset data = load(folder / "scene", &warnings);
  CHECK(data.split.find("every 4th") != std::string::npos);
  REQUIRE(data.test.size() == 2);
  CHECK(data.test[0].name == "00");
  CHECK(data.test[1].name == "04");
  REQUIRE(data.train.size() == 4);
  CHECK(data.train[3].name == "05");
}

TEST_CASE("evdeblur: nanoseconds and 0/1 polarity are recognised", "[data]") {
  const test::TempDir folder;
  const EvDeblurContent content = test::tiny_content();
  write_evdeblur(folder / "scene", content);
  const test::RawEvents raw = test::raw_events(content.events);
  std::vector<uint16_t> x(raw.x.begin(), raw.x.end());
  std::vector<uint16_t> y(raw.y.begin(), raw.y.end());
  std::vector<int64_t> t;
  std::vector<uint8_t> p;
  for (const double value : raw.t) t.push_back(static_cast<int64_t>(1000 * value));
  for (const double value : raw.p) p.push_back(value > 0 ? 1 : 0);
  io::Hdf5Writer writer(folder / "scene/events.h5");
  writer.append("x", x.data(), 1000);
  writer.append("y", y.data(), 1000);
  writer.append("t", t.data(), 1000);
  writer.append("p", p.data(), 1000);
  writer.close();
  const Dataset data = load(folder / "scene");
  CHECK(torch::equal(data.events.t_us(), content.events.t_us()));
  CHECK(torch::equal(data.events.polarity(), content.events.polarity()));
  CHECK(data.train[0].events.size() == 80);
}

TEST_CASE("evdeblur: without a dense trajectory the poses follow those of the frames", "[data]") {
  const test::TempDir folder;
  const EvDeblurContent content = test::tiny_content();
  write_evdeblur(folder / "scene", content);
  fs::remove(folder / "scene/all_poses_bounds.npy");
  fs::remove(folder / "scene/all_timestamps.npy");
  std::vector<std::string> warnings;
  const Dataset data = load(folder / "scene", &warnings);
  CHECK(mentions(warnings, "no dense trajectory"));
  CHECK(data.trajectory.empty());
  for (size_t i = 0; i < 4; ++i) {
    for (size_t k = 0; k < 9; ++k) {
      CHECK(pose_distance(data.train[i].poses[k], content.train[i].poses[k]) < 1e-5);
    }
  }
}

TEST_CASE("evdeblur: events outside the trajectory's times are dropped", "[data]") {
  const test::TempDir folder;
  EvDeblurContent content = test::tiny_content();
  content.path_t_us.erase(content.path_t_us.begin(), content.path_t_us.begin() + 5);
  content.path.erase(content.path.begin(), content.path.begin() + 5);
  write_evdeblur(folder / "scene", content);
  const Dataset data = load(folder / "scene");
  CHECK(data.events.first_us() == 5000);
  CHECK(data.events.size() == 950);
}

TEST_CASE("evdeblur: a colour filter is read when there is one and wanted", "[data]") {
  const test::TempDir folder;
  EvDeblurContent content = test::tiny_content();
  write_evdeblur(folder / "gray", content);
  CHECK_FALSE(load(folder / "gray").event_color.defined());
  content.color_events = true;
  write_evdeblur(folder / "scene", content);
  DatasetOptions options;
  options.path = folder / "scene";
  const Dataset data = load_dataset(options);
  REQUIRE(data.event_color.defined());
  CHECK(data.event_color.sum().item<int64_t>() == test::kWidth * test::kHeight);
  options.color_events = false;
  CHECK_FALSE(load_dataset(options).event_color.defined());
}

TEST_CASE("evdeblur: points of structure from motion are restored, damaged ones are refused",
          "[data]") {
  const test::TempDir folder;
  EvDeblurContent content = test::tiny_content();
  content.points = torch::rand({5, 3}, torch::kFloat64);
  content.point_colors = torch::randint(0, 256, {5, 3}, torch::kUInt8);
  write_evdeblur(folder / "scene", content);
  const Dataset data = load(folder / "scene");
  CHECK(torch::equal(data.points, content.points.to(torch::kFloat32)));
  CHECK(torch::equal(data.point_colors, content.point_colors.to(torch::kFloat32) / 255));
  content.points[3][1] = NAN;
  write_evdeblur(folder / "scene", content);
  CHECK(load(folder / "scene").points.size(0) == 4);
  io::write_npz(folder / "scene/points.npz", {{"points", torch::zeros({4, 2})},
                                              {"colors", torch::zeros({4, 2}, torch::kUInt8)}});
  CHECK_THROWS_NAMING(DataError, load(folder / "scene"), "points.npz", "[P,3]");
}

TEST_CASE("evdeblur: held-out exposures are kept from training", "[data]") {
  const test::TempDir folder;
  EvDeblurContent content = test::tiny_content();
  content.held_out = {false, true, false, false};
  write_evdeblur(folder / "scene", content);
  const Dataset data = load(folder / "scene");
  REQUIRE(data.train.size() == 3);
  REQUIRE(data.held_out.size() == 1);
  CHECK(data.held_out[0].t_start_us == content.train[1].t_start_us);
  CHECK(torch::allclose(data.held_out[0].blurry, content.train[1].blurry, 0, 1e-6));
  CHECK(data.train[1].t_start_us == content.train[2].t_start_us);
  // Its sharp view is one that training no longer sees.
  CHECK(data.test[0].seen == false);
}

TEST_CASE("evdeblur: no sharp frame is a warning, unless exposures are held out", "[data]") {
  const test::TempDir folder;
  EvDeblurContent content = test::tiny_content();
  content.test.clear();
  for (const bool holds_out : {false, true}) {
    if (holds_out) content.held_out = {false, true, false, false};
    const fs::path scene = folder / (holds_out ? "held" : "none");
    write_evdeblur(scene, content);
    std::vector<std::string> warnings;
    load(scene, &warnings);
    CHECK(mentions(warnings, "no test views") != holds_out);
  }
}

TEST_CASE("evdeblur: held-out names that are no exposure, or all of them, are refused", "[data]") {
  const test::TempDir folder;
  write_evdeblur(folder / "scene", test::tiny_content());
  write_file(folder / "scene" / kHeldOutFile, "01\n77\n");
  CHECK_THROWS_NAMING(DataError, load(folder / "scene"), "'77'");
  write_file(folder / "scene" / kHeldOutFile,
             "\xEF\xBB\xBF"
             "00\n01\r\n02\n\n03\n");
  CHECK_THROWS_NAMING(DataError, load(folder / "scene"), "every exposure");
}

TEST_CASE("evdeblur: lists may store the accents of names in another form; UTF-16 is named",
          "[data]") {
  const test::TempDir folder;
  const fs::path scene = folder / "scene";
  write_evdeblur(scene, test::tiny_content());
  const std::string composed = "0\xC3\xA9", decomposed = "0e\xCC\x81";
  fs::rename(scene / "images_1/01.png", scene / "images_1" / (composed + ".png"));
  write_file(scene / kHeldOutFile, decomposed + "\n");
  write_file(scene / kGainFile, "name,gain\n" + decomposed + ",2\n00,3\n02,3\n03,3\n04,3\n05,3\n");
  std::vector<std::string> warnings;
  const Dataset data = load(scene, &warnings);
  REQUIRE(data.held_out.size() == 1);
  CHECK(data.held_out[0].name == composed);
  CHECK(mentions(warnings, "held_out.txt"));
  fs::remove(scene / kGainFile);
  std::string wide = "\xFF\xFE";
  for (const char letter : std::string("02\r\n")) wide += std::string{letter, '\0'};
  write_file(scene / kHeldOutFile, wide);
  CHECK_THROWS_NAMING(DataError, load(scene), kHeldOutFile, "UTF-16", "iconv");
}

TEST_CASE("evdeblur: a row of another image size is reported", "[data]") {
  const test::TempDir folder;
  write_evdeblur(folder / "scene", test::tiny_content());
  torch::Tensor rows = io::read_npy(folder / "scene/poses_bounds.npy").clone();
  rows[3][4] = 26;
  rows[3][9] = 42;
  io::write_npy(folder / "scene/poses_bounds.npy", rows);
  std::vector<std::string> warnings;
  load(folder / "scene", &warnings);
  CHECK(mentions(warnings, "42x26 in row 3"));
}

}  // namespace
}  // namespace jade::data
