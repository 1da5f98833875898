// SPDX-License-Identifier: Apache-2.0
#include "jade/data/diet_gs.h"

#include "support/catch.h"

#include <filesystem>
#include <torch/types.h>

#include "data/tiny_recording.h"
#include "jade/core/error.h"
#include "jade/imaging/image_io.h"
#include "jade/io/hdf5.h"
#include "jade/io/npy.h"
#include "support/colmap_writer.h"
#include "support/naming.h"
#include "support/temp_dir.h"

namespace jade::data {
namespace {

namespace fs = std::filesystem;

/// Two frames of nine poses and two sharp views, written in reverse order to show that names and
/// not the order of the file matter.
struct DietScene {
  test::TempDir temp;
  fs::path root = temp / "blurtest";
  std::vector<io::ColmapImage> images;
  io::ColmapCamera camera{1, "PINHOLE", test::kWidth, test::kHeight, {25, 25, 10.5, 6.5}};
  DatasetOptions options;

  DietScene() {
    options.path = root;
    int64_t id = 30;
    for (int64_t frame = 0; frame < 2; ++frame) {
      for (int64_t k = 0; k < 9; ++k) {
        images.push_back(image(--id, concat(frame, "_", k, ".png"), frame * 20000.0 + k * 1000.0));
      }
    }
    images.push_back(image(--id, "GT0.png", 4000));
    images.push_back(image(--id, "GT1.png", 90000));
    for (int i = 0; i < 4; ++i) {
      imaging::write_image(root / "images" / concat("0", i, ".png"), test::noise_image(i));
    }
    fs::create_directories(root / "events");
    const torch::Tensor start = torch::tensor({10000, 30000}, torch::kInt64);
    io::write_npz(root / "events/timestamps.npz",
                  {{"timestamps_start", start}, {"timestamps_end", start + 8000}});
    const test::RawEvents raw = test::raw_events(test::tiny_content().events);
    io::Hdf5Writer writer(root / "events/events.h5");
    writer.append("x", raw.x.data(), 1000);
    writer.append("y", raw.y.data(), 1000);
    writer.append("t", raw.t.data(), 1000);
    writer.append("p", raw.p.data(), 1000);
    writer.close();
  }
  static io::ColmapImage image(int64_t id, const std::string& name, double t_us) {
    const geometry::Pose pose = test::steady_pose(t_us);
    return {id, geometry::quaternion_from_rotation(pose.rotation), pose.translation, 1, name};
  }
  Dataset load(bool binary = true, std::vector<std::string>* warnings = nullptr) {
    fs::remove_all(root / "sparse");
    const std::vector<double> points = {0, 0, 5, 0.1, 0.2, 6, 1, 1, 7};
    test::save_model(root / "sparse/0", binary ? test::binary_model(camera, images, points)
                                               : test::text_model(camera, images, points));
    return load_dataset(options, warnings);
  }
};

TEST_CASE("diet_gs: names give every frame its nine poses, binary or text", "[data]") {
  DietScene scene;
  for (const bool binary : {true, false}) {
    std::vector<std::string> warnings;
    const Dataset data = scene.load(binary, &warnings);
    CHECK(warnings.empty());
    CHECK(data.kind == DatasetKind::kDietGs);
    REQUIRE(data.train.size() == 2);
    for (int64_t frame = 0; frame < 2; ++frame) {
      for (int64_t k = 0; k < 9; ++k) {
        const geometry::Pose expected = test::steady_pose(frame * 20000.0 + k * 1000.0);
        CHECK(test::pose_distance(data.train[size_t(frame)].poses[size_t(k)], expected) < 1e-6);
      }
      CHECK(test::same_image(data.train[size_t(frame)].blurry, test::noise_image(frame)));
      CHECK(data.train[size_t(frame)].events.size() == 80);
    }
    REQUIRE(data.test.size() == 2);
    CHECK(data.test[1].name == "03");
    // The first view has the fifth pose of frame 0; the model does not contain the time of the
    // other.
    CHECK(data.test[0].seen == true);
    CHECK_FALSE(data.test[1].seen.has_value());
    CHECK(test::same_image(data.test[1].image, test::noise_image(3)));
    CHECK(test::pose_distance(data.test[1].pose, test::steady_pose(90000)) < 1e-6);
    CHECK(data.points.size(0) == 3);
    CHECK(data.point_colors[0][1].item<float>() == Approx(20 / 255.0));
    CHECK(data.far > data.near);
  }
}

TEST_CASE("diet_gs: a sharp view without a time is seen from the pose of an exposure", "[data]") {
  const Dataset data = DietScene().load();
  // The last pose, rotated and displaced from the others.
  const geometry::Pose& pose = data.train[1].poses[8];
  const auto seen = [&](double turn, double shift) {
    SharpView view = data.test[0];
    const auto centre = geometry::centre(pose);
    const geometry::Pose turned{geometry::rotation_from_vector({0, turn, 0}), {0, 0, 0}};
    view.pose = geometry::pose_at_centre(geometry::compose(turned, pose).rotation,
                                         {centre[0] + shift * data.near, centre[1], centre[2]});
    return is_seen(data, view);
  };
  CHECK(seen(0, 0) == true);
  CHECK(seen(0.8e-3, 0.8e-3) == true);
  CHECK_FALSE(seen(1.2e-3, 0).has_value());
  CHECK_FALSE(seen(0, 1.2e-3).has_value());
}

TEST_CASE("diet_gs: frames and events are undistorted together", "[data]") {
  DietScene scene;
  const Dataset before = scene.load(false);
  scene.camera = {1, "SIMPLE_RADIAL", test::kWidth, test::kHeight, {25, 10.5, 6.5, 0.9}};
  std::vector<std::string> warnings;
  const Dataset data = scene.load(false, &warnings);
  CHECK(warnings.empty());
  CHECK(data.notes.size() == 2);
  CHECK(data.train[0].mask.defined());
  CHECK(data.test[0].mask.defined());
  CHECK_FALSE(data.train[0].blurry.equal(before.train[0].blurry));
  // A pincushion lens moves all events inwards. Those at pixels without a source are dropped.
  CHECK(data.events.size() > 900);
  CHECK(data.events.size() <= before.events.size());
  CHECK(data.events.x().max().item<float>() < before.events.x().max().item<float>() - 0.5F);
  CHECK(data.events.x().min().item<float>() > before.events.x().min().item<float>() + 0.5F);
  CHECK(data.train[1].events.size() > 60);
}

TEST_CASE("diet_gs: a frame that lacks poses, or is missing, is named", "[data]") {
  DietScene scene;
  scene.images.erase(scene.images.begin() + 11);
  CHECK_THROWS_WITH(scene.load(), test::naming("frame 1", "8 of 9") && Catch::Contains("1_2"));
  scene.images.erase(scene.images.begin(), scene.images.begin() + 9);
  CHECK_THROWS_NAMING(DataError, scene.load(), "frame 0", "pose");
}

TEST_CASE("diet_gs: pickles that were not converted lead to the script", "[data]") {
  DietScene scene;
  fs::remove(scene.root / "events/events.h5");
  CHECK_THROWS_WITH(scene.load(), Catch::Contains("scripts/convert_diet_gs.py"));
}

TEST_CASE("diet_gs: too few images or windows for the model are reported", "[data]") {
  DietScene scene;
  fs::remove(scene.root / "images/03.png");
  CHECK_THROWS_WITH(scene.load(), Catch::Contains("3 images") && test::naming("so 4"));
  DietScene second;
  const torch::Tensor one = torch::tensor({10000}, torch::kInt64);
  io::write_npz(second.root / "events/timestamps.npz",
                {{"timestamps_start", one}, {"timestamps_end", one + 8000}});
  CHECK_THROWS_NAMING(DataError, second.load(), "1 windows", "2 frames");
}

TEST_CASE("diet_gs: a model that lacks the last frame is a warning, as sharp views would be wrong",
          "[data]") {
  DietScene scene;
  scene.images.erase(scene.images.begin() + 9, scene.images.begin() + 18);
  std::vector<std::string> warnings;
  scene.load(false, &warnings);
  REQUIRE_FALSE(warnings.empty());
  CHECK_THAT(warnings[0], test::naming("1 frames and then 2 sharp", "4 images", "of 2 frames"));
  std::vector<std::string> without;
  scene.options.split = SplitKind::kNone;
  scene.load(false, &without);
  CHECK(without.size() == warnings.size() - 1);
}

TEST_CASE("diet_gs: strange names and repeated poses are refused", "[data]") {
  DietScene scene;
  scene.images[0].name = "frame.png";
  scene.options.kind = DatasetKind::kDietGs;
  CHECK_THROWS_WITH(scene.load(), Catch::Contains("'frame.png'"));
  scene.images[0].name = "0_1.png";
  CHECK_THROWS_NAMING(DataError, scene.load(), "two", "'0_1.png'");
}

}  // namespace
}  // namespace jade::data
