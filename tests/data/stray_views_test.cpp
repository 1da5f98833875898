// SPDX-License-Identifier: Apache-2.0
#include "jade/data/stray_views.h"

#include "support/catch.h"

#include <algorithm>
#include <filesystem>
#include <torch/types.h>

#include "data/tiny_recording.h"
#include "jade/data/frames.h"
#include "jade/imaging/image_io.h"
#include "support/colmap_writer.h"
#include "support/naming.h"
#include "support/temp_dir.h"

namespace jade::data {
namespace {

namespace fs = std::filesystem;

geometry::Pose moved(geometry::Pose pose, double away) {
  pose.translation[0] += away;
  return pose;
}

/// A COLMAP scene of 16 images, of which those of `wrong` lie `away` units off.
Dataset colmap_with(const fs::path& root, const std::vector<int>& wrong, double away,
                    std::vector<std::string>* warnings) {
  std::vector<io::ColmapImage> images;
  for (int i = 0; i < 16; ++i) {
    geometry::Pose pose = test::steady_pose(1e5 * i);
    if (std::count(wrong.begin(), wrong.end(), i) > 0) pose = moved(pose, away);
    const std::string name = concat("img_", 10 + i, ".png");
    images.push_back(
        {i + 1, geometry::quaternion_from_rotation(pose.rotation), pose.translation, 1, name});
    imaging::write_image(root / "images" / name, test::noise_image(i));
  }
  std::vector<double> points;
  for (int i = 0; i < 20; ++i) {
    for (const double value : {0.1 * i, -0.05 * i, 4.0 + 0.1 * i}) points.push_back(value);
  }
  const io::ColmapCamera camera{1, "PINHOLE", test::kWidth, test::kHeight, {25, 25, 10.5, 6.5}};
  test::save_model(root / "sparse/0", test::text_model(camera, images, points));
  DatasetOptions options;
  options.path = root;
  return load_dataset(options, warnings);
}

TEST_CASE("stray views: wrong poses far away are named and do not set the bounds", "[data]") {
  const test::TempDir folder;
  std::vector<std::string> honest, warned;
  const Dataset good = colmap_with(folder / "good", {}, 0, &honest);
  CHECK(honest.empty());
  const Dataset bad = colmap_with(folder / "bad", {3, 8, 9}, 4000, &warned);
  REQUIRE(warned.size() == 1);
  CHECK_THAT(warned[0], test::naming("img_13", "img_18", "img_19", "3 of 16"));
  CHECK(bad.near == Approx(good.near).epsilon(0.05));
  CHECK(bad.far == Approx(good.far).epsilon(0.05));
  for (const Exposure& exposure : bad.train) {
    CHECK(exposure.stray == (exposure.name == "img_13" || exposure.name == "img_19"));
  }
}

TEST_CASE("stray views: a row of poses_bounds.npy far away is named and left out of the path",
          "[data]") {
  std::vector<geometry::Pose> poses;
  for (int i = 0; i < 20; ++i) poses.push_back(test::steady_pose(1e5 * i));
  const DepthBounds good = depth_bounds({}, poses);
  CHECK(without_strays(poses, {}).size() == 20);
  poses[0] = moved(poses[0], 5000);
  CHECK(without_strays(poses, {}).size() == 19);
  CHECK(depth_bounds({}, poses).far == Approx(good.far).epsilon(0.1));

  const test::TempDir folder;
  EvDeblurContent content = test::tiny_content();
  for (int64_t i = 4; i < 12; ++i) {
    content.train.push_back(content.train[0]);
    content.train.back().t_start_us += 20000 * i;
    content.train.back().t_end_us += 20000 * i;
    content.train.back().poses[geometry::kMidPose] =
        test::steady_pose(14000.0 + 20000.0 * double(i));
  }
  for (int64_t t_us = 101000; t_us <= 300000; t_us += 1000) {
    content.path_t_us.push_back(t_us);
    content.path.push_back(test::steady_pose(double(t_us)));
  }
  content.sharp_mid.clear();
  for (geometry::Pose& pose : content.train[7].poses) pose = moved(pose, 1e5);
  write_evdeblur(folder / "scene", content);
  fs::remove(folder / "scene/all_poses_bounds.npy");
  fs::remove(folder / "scene/all_timestamps.npy");
  DatasetOptions options;
  options.path = folder / "scene";
  std::vector<std::string> lines;
  const Dataset data = load_dataset(options, &lines);
  const auto told = std::find_if(lines.begin(), lines.end(), [](const std::string& line) {
    return line.find("far from all others") != std::string::npos;
  });
  REQUIRE(told != lines.end());
  CHECK_THAT(*told, test::naming("poses_bounds.npy", data.train[7].name));
  for (const Exposure& exposure : data.train) {
    CHECK_FALSE(exposure.stray);
    CHECK(test::pose_distance(exposure.poses[0], test::steady_pose(double(exposure.t_start_us))) <
          0.01);
  }
}

}  // namespace
}  // namespace jade::data
