// SPDX-License-Identifier: Apache-2.0
#include "jade/data/colmap_scene.h"

#include "support/catch.h"

#include <cmath>
#include <filesystem>
#include <torch/types.h>

#include "data/tiny_recording.h"
#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/imaging/image_io.h"
#include "support/colmap_writer.h"
#include "support/temp_dir.h"

namespace jade::data {
namespace {

namespace fs = std::filesystem;

DatasetOptions dataset_at(const fs::path& folder) {
  DatasetOptions options;
  options.path = folder;
  return options;
}

/// Ten sharp images img_00 to img_09 with a model of 2 x their size.
void write_colmap_scene(const fs::path& root, const io::ColmapCamera& camera) {
  std::vector<io::ColmapImage> images;
  for (int i = 9; i >= 0; --i) {
    const geometry::Pose pose = test::steady_pose(1e5 * i);
    const std::string name = concat("img_0", i, ".png");
    images.push_back({i + 1, geometry::quaternion_from_rotation(pose.rotation), pose.translation,
                      camera.id, name});
    imaging::write_image(root / "images" / name, test::noise_image(i));
  }
  std::vector<double> points;
  for (int i = 0; i < 20; ++i) {
    for (const double value : {0.1 * i, -0.05 * i, 4.0 + 0.1 * i}) points.push_back(value);
  }
  test::save_model(root / "sparse/0", test::binary_model(camera, images, points));
}

TEST_CASE("colmap scene: every eighth image by name is a test view, cameras fit the images",
          "[data]") {
  const test::TempDir folder;
  write_colmap_scene(folder / "room",
                     {1, "PINHOLE", 2 * test::kWidth, 2 * test::kHeight, {50, 60, 22, 13}});
  std::vector<std::string> warnings;
  const Dataset data = load_dataset(dataset_at(folder / "room"), &warnings);
  CHECK(warnings.empty());
  CHECK(data.kind == DatasetKind::kColmap);
  REQUIRE(data.test.size() == 2);
  CHECK(data.test[1].name == "img_08");
  CHECK(data.test[1].seen == false);
  REQUIRE(data.train.size() == 8);
  const Exposure& first = data.train[0];
  CHECK(first.name == "img_01");
  CHECK(first.duration_us() == 0);
  CHECK(first.events.empty());
  CHECK(first.camera.fx == Approx(25));
  CHECK(first.camera.fy == Approx(30));
  CHECK(first.camera.cx == Approx(11));
  CHECK(first.camera.cy == Approx(6.5));
  CHECK(test::pose_distance(first.poses[8], test::steady_pose(1e5)) < 1e-6);
  CHECK(test::same_image(first.blurry, test::noise_image(1)));
  CHECK(data.near > 0);
  CHECK(data.far > data.near);
  DatasetOptions all = dataset_at(folder / "room");
  all.split = SplitKind::kNone;
  CHECK(load_dataset(all).train.size() == 10);
}

TEST_CASE("colmap scene: of a camera with two focal lengths x has the first and y the second",
          "[data]") {
  const io::ColmapCamera two = {1, "PINHOLE", 20, 10, {30, 40, 9, 6}};
  CHECK(camera_of(two, 20, 10, Warnings(nullptr)) == geometry::Intrinsics{30, 40, 9, 6, 20, 10});
  CHECK(camera_of(two, 40, 5, Warnings(nullptr)) == geometry::Intrinsics{60, 20, 18, 3, 40, 5});
  const io::ColmapCamera one = {1, "SIMPLE_PINHOLE", 20, 10, {30, 9, 6}};
  CHECK(camera_of(one, 20, 10, Warnings(nullptr)) == geometry::Intrinsics{30, 30, 9, 6, 20, 10});
}

TEST_CASE("colmap scene: a fisheye is no pinhole, whatever its coefficients", "[data]") {
  const auto read = [](const io::ColmapCamera& camera) {
    return camera_of(camera, 96, 64, Warnings(nullptr));
  };
  CHECK_THROWS_WITH(
      read({1, "OPENCV_FISHEYE", 96, 64, {60, 60, 48, 32, 0.001, 0, 0, 0}}),
      Catch::Contains("bends the corners by 2") && Catch::Contains("undistort the images first"));
  CHECK_THROWS_WITH(read({1, "SIMPLE_RADIAL_FISHEYE", 96, 64, {30, 48, 32, 0}}),
                    Catch::Contains("sees farther than any pinhole"));
  // Of a field so narrow that nobody can tell.
  CHECK(read({1, "SIMPLE_RADIAL_FISHEYE", 96, 64, {400, 48, 32, 0}}).fx == 400);
  CHECK(fisheye_shift_px(60, 96, 64) == Approx(60 * std::tan(57.6888 / 60) - 57.6888).margin(0.01));
}

TEST_CASE("colmap scene: a model without images is told as that", "[data]") {
  const test::TempDir folder;
  write_colmap_scene(folder / "room",
                     {1, "PINHOLE", test::kWidth, test::kHeight, {25, 25, 10.5, 6.5}});
  fs::remove_all(folder / "room/sparse");
  test::save_model(folder / "room/sparse/0",
                   {"1 PINHOLE 21 13 25 25 10.5 6.5\n", "# none\n", "", false, ""});
  CHECK_THROWS_WITH(load_dataset(dataset_at(folder / "room")),
                    Catch::Contains("expected images with poses, found none"));
}

TEST_CASE("colmap scene: images without a file are named, strong distortion is refused", "[data]") {
  const test::TempDir folder;
  write_colmap_scene(folder / "room",
                     {1, "PINHOLE", test::kWidth, test::kHeight, {25, 25, 10.5, 6.5}});
  fs::remove(folder / "room/images/img_03.png");
  std::vector<std::string> warnings;
  CHECK(load_dataset(dataset_at(folder / "room"), &warnings).train.size() == 7);
  CHECK(test::mentions(warnings, "img_03.png"));

  const io::ColmapFiles bent = {"1 SIMPLE_RADIAL 21 13 25 10.5 6.5 0.9\n",
                                "1 1 0 0 0 0 0 0 1 img_00.png\n\n2 1 0 0 0 1 0 0 1 img_01.png\n\n",
                                "", false, ""};
  fs::remove_all(folder / "room/sparse");
  test::save_model(folder / "room/sparse/0", bent);
  CHECK_THROWS_WITH(load_dataset(dataset_at(folder / "room")),
                    Catch::Contains("image_undistorter"));
}

}  // namespace
}  // namespace jade::data
