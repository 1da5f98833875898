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
#include "support/naming.h"
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
  CHECK(lens_camera_of(two, 20, 10).pinhole() == geometry::Intrinsics{30, 40, 9, 6, 20, 10});
  CHECK(lens_camera_of(two, 40, 20).pinhole() == geometry::Intrinsics{60, 80, 18, 12, 40, 20});
  const io::ColmapCamera one = {1, "SIMPLE_PINHOLE", 20, 10, {30, 9, 6}};
  CHECK(lens_camera_of(one, 20, 10).pinhole() == geometry::Intrinsics{30, 30, 9, 6, 20, 10});
}

TEST_CASE("colmap scene: a camera of another shape than its image is refused", "[data]") {
  const io::ColmapCamera camera = {7, "PINHOLE", 48, 64, {60, 60, 24, 32}};
  CHECK_THROWS_AS(lens_camera_of(camera, 64, 48), DataError);
  CHECK_THROWS_WITH(lens_camera_of(camera, 64, 48), Catch::Contains("camera 7") &&
                                                        Catch::Contains("48x64") &&
                                                        Catch::Contains("64x48"));
  CHECK_THROWS_AS(lens_camera_of(camera, 48, 48), DataError);
  // Programs round an odd size up or down when they halve it.
  CHECK(lens_camera_of({7, "PINHOLE", 97, 65, {60, 60, 24, 32}}, 48, 33).pinhole().width == 48);
}

TEST_CASE("colmap scene: every camera model of COLMAP 4 puts points where pycolmap does",
          "[data]") {
  const auto check = [](const std::string& model, const std::vector<double>& parameters, double u,
                        double v) {
    INFO(model);
    const auto place =
        lens_camera_of({1, model, 640, 480, parameters}, 640, 480).project({-0.7, 0.5, 1.1});
    CHECK(place[0] == Approx(u).margin(1e-5));
    CHECK(place[1] == Approx(v).margin(1e-5));
  };
  check("SIMPLE_RADIAL", {500, 320, 240, -0.1}, 21.277235161532758, 453.3734030456048);
  check("RADIAL", {500, 320, 240, -0.1, 0.02}, 18.897119545982378, 455.0734860384036);
  check("OPENCV", {500, 510, 320, 240, -0.3, 0.1, 1e-3, -7e-4}, 47.50798691097856,
        438.68584566379593);
  check("FULL_OPENCV", {500, 510, 320, 240, 0.3, -0.1, 1e-3, 2e-3, 0.02, 0.65, -0.12, 0.05},
        52.735038708946036, 435.47908809056605);
  check("OPENCV_FISHEYE", {500, 510, 320, 240, 0.02, -0.008, 0.004, -0.001}, 47.92599062723576,
        438.22534968587115);
  check("FOV", {500, 510, 320, 240, 0.9}, 27.49499686, 453.110788);
  check("SIMPLE_DIVISION", {500, 320, 240, -0.1}, 19.2083055, 454.85121036);
  check("DIVISION", {500, 510, 320, 240, -0.1}, 19.2083055, 459.14823456);
  check("SIMPLE_FISHEYE", {500, 320, 240}, 49.967873976925205, 432.88009001648203);
  check("FISHEYE", {500, 510, 320, 240}, 49.967873976925205, 436.73769181681166);
  check("RADIAL_FISHEYE", {500, 320, 240, 0.1, -0.01}, 38.597414620286486, 441.00184669979546);
  check("EUCM", {500, 510, 320, 240, 0.6, 1.1}, 49.43809193, 437.12367588);
  check("THIN_PRISM_FISHEYE",
        {500, 510, 320, 240, 0.02, -0.01, 0.003, -0.002, 0.004, -0.001, 0.005, -0.006}, 47.48315129,
        438.35543695);
  check("RAD_TAN_THIN_PRISM_FISHEYE",
        {500, 510, 320, 240, 0.02, -0.01, 0.004, -0.001, 0.002, -0.0005, 0.003, -0.002, 0.005,
         0.001, -0.006, 0.002},
        51.22039249, 435.58065025);
  CHECK_THROWS_WITH(lens_camera_of({3, "EQUIRECTANGULAR", 640, 480, {640, 480}}, 640, 480),
                    Catch::Contains("EQUIRECTANGULAR"));
  CHECK_THROWS_AS(lens_camera_of({3, "PINHOLE", 640, 480, {500, -500, 320, 240}}, 640, 480),
                  DataError);
}

TEST_CASE("colmap scene: images of two sizes with a camera each are read", "[data]") {
  const test::TempDir folder;
  const fs::path room = folder / "room";
  imaging::write_image(room / "images/a.png", test::noise_image(0));
  imaging::write_image(room / "images/b.png", test::noise_image(1).slice(2, 2));
  imaging::write_image(room / "images/c.png", test::noise_image(2).transpose(1, 2).contiguous());
  const io::ColmapFiles files = {
      "1 PINHOLE 21 13 25 25 10.5 6.5\n2 PINHOLE 19 13 25 25 8.5 6.5\n3 PINHOLE 13 21 25 25 6.5 "
      "10.5\n",
      "1 1 0 0 0 0 0 0 1 a.png\n\n2 1 0 0 0 1 0 0 2 b.png\n\n3 1 0 0 0 2 0 0 3 c.png\n\n", "",
      false, ""};
  test::save_model(room / "sparse/0", files);
  DatasetOptions options = dataset_at(room);
  options.split = SplitKind::kNone;
  const Dataset data = load_dataset(options);
  REQUIRE(data.train.size() == 3);
  CHECK(data.train[1].camera == geometry::Intrinsics{25, 25, 8.5, 6.5, 19, 13});
  CHECK(data.train[2].camera.height == 21);
  CHECK(data.train[2].blurry.size(1) == 21);
}

TEST_CASE(
    "colmap scene: of several reconstructions the largest is used and the others are reported",
    "[data]") {
  const test::TempDir folder;
  const fs::path room = folder / "room";
  write_colmap_scene(room, {1, "PINHOLE", test::kWidth, test::kHeight, {25, 25, 10.5, 6.5}});
  fs::rename(room / "sparse/0", room / "sparse/2");
  const io::ColmapFiles small = {"1 PINHOLE 21 13 25 25 10.5 6.5\n",
                                 "1 1 0 0 0 0 0 0 1 img_00.png\n\n2 1 0 0 0 1 0 0 1 "
                                 "img_01.png\n\n",
                                 "", false, ""};
  test::save_model(room / "sparse/0", small);
  std::vector<std::string> warnings;
  CHECK(load_dataset(dataset_at(room), &warnings).train.size() == 8);
  REQUIRE(warnings.size() == 1);
  CHECK(test::mentions(warnings, "2 with 10 images; left out: 0 with 2 images"));
  fs::remove_all(room / "sparse/0");
  warnings.clear();
  CHECK(load_dataset(dataset_at(room), &warnings).train.size() == 8);
  CHECK(warnings.empty());
}

TEST_CASE("colmap scene: a model without images is reported as such", "[data]") {
  const test::TempDir folder;
  write_colmap_scene(folder / "room",
                     {1, "PINHOLE", test::kWidth, test::kHeight, {25, 25, 10.5, 6.5}});
  fs::remove_all(folder / "room/sparse");
  test::save_model(folder / "room/sparse/0",
                   {"1 PINHOLE 21 13 25 25 10.5 6.5\n", "# none\n", "", false, ""});
  CHECK_THROWS_NAMING(DataError, load_dataset(dataset_at(folder / "room")), "images", "none");
}

TEST_CASE("colmap scene: images without a file are named, strong distortion is undistorted",
          "[data]") {
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
  warnings.clear();
  const Dataset data = load_dataset(dataset_at(folder / "room"), &warnings);
  REQUIRE(data.notes.size() == 1);
  CHECK(data.notes[0].find("SIMPLE_RADIAL") != std::string::npos);
  const Exposure& straight = data.train.at(0);
  CHECK(straight.camera == geometry::Intrinsics{25, 25, 10.5, 6.5, 21, 13});
  REQUIRE(straight.mask.defined());
  CHECK_FALSE(straight.mask[0][0][0].item<bool>());
  CHECK(straight.mask[0][6][10].item<bool>());
  // The map is the identity on the axis.
  CHECK((straight.blurry - test::noise_image(1))
            .abs()
            .select(1, 6)
            .select(1, 10)
            .max()
            .item<float>() < 0.05);
}

TEST_CASE("colmap scene: images without a pose and known parts that are not used are reported",
          "[data]") {
  const test::TempDir folder;
  write_colmap_scene(folder / "room",
                     {1, "PINHOLE", test::kWidth, test::kHeight, {25, 25, 10.5, 6.5}});
  imaging::write_image(folder / "room/images/img_10.png", test::noise_image(10));
  folder.write("room/depths/img_00.png", "x");
  folder.write("room/sparse/0/test.txt", "img_00.png\n");
  std::vector<std::string> warnings;
  CHECK(load_dataset(dataset_at(folder / "room"), &warnings).train.size() == 8);
  REQUIRE(warnings.size() == 2);
  CHECK_THAT(warnings[0], Catch::Contains("1 of 11 images") && Catch::Contains("img_10.png"));
  CHECK_THAT(warnings[1], Catch::Contains("depths/") && Catch::Contains("test.txt"));
}

const io::ColmapCamera kCamera = {1, "PINHOLE", test::kWidth, test::kHeight, {25, 25, 10.5, 6.5}};

TEST_CASE("colmap scene: cameras that no image can have are refused", "[data]") {
  const auto load = [](const std::vector<double>& parameters) {
    return lens_camera_of({7, "PINHOLE", 64, 48, parameters}, 32, 24);
  };
  CHECK(load({60, 60, 20, 30}).pinhole().cx == Approx(10));
  CHECK_THROWS_NAMING(DataError, load({60, 60, 3200, 24}), "camera 7", "principal point", "64x48",
                      "3200");
  CHECK_THROWS_NAMING(DataError, load({60, 60, 32, -49}), "principal point");
  CHECK_THROWS_NAMING(DataError, load({60, 6e7, 32, 24}), "focal lengths", "6400");
  CHECK_THROWS_NAMING(DataError, load({0.035, 0.035, 32, 24}), "focal lengths", "3.2", "0.035");
}

TEST_CASE("colmap scene: images in folders of their cameras are found", "[data]") {
  const test::TempDir folder;
  const fs::path room = folder / "room";
  const std::string names[] = {"cam0/000.png", "cam0/001.png", "cam1/000.png", "cam1/001.png"};
  std::vector<io::ColmapImage> images;
  for (int i = 0; i < 4; ++i) {
    const geometry::Pose pose = test::steady_pose(1e5 * i);
    images.push_back(
        {i + 1, geometry::quaternion_from_rotation(pose.rotation), pose.translation, 1, names[i]});
    imaging::write_image(room / "images" / names[i], test::noise_image(i));
  }
  test::save_model(room / "sparse/0", test::binary_model(kCamera, images, {0, 0, 4}));
  DatasetOptions options = dataset_at(room);
  options.split = SplitKind::kNone;
  std::vector<std::string> warnings;
  const Dataset data = load_dataset(options, &warnings);
  CHECK(warnings.empty());
  REQUIRE(data.train.size() == 4);
  CHECK(data.train[2].name == "cam1_000");
  CHECK(test::same_image(data.train[2].blurry, test::noise_image(2)));
  // Includes images of a camera that the model lacks.
  imaging::write_image(room / "images/cam2/000.png", test::noise_image(9));
  load_dataset(options, &warnings);
  CHECK(test::mentions(warnings, "1 of 5 images"));
  CHECK(test::mentions(warnings, "cam2/000.png"));
}

TEST_CASE("colmap scene: two names of one file are refused with both", "[data]") {
  const test::TempDir folder;
  const fs::path room = folder / "room";
  std::vector<io::ColmapImage> images;
  for (int i = 0; i < 2; ++i) {
    const geometry::Pose pose = test::steady_pose(1e5 * i);
    images.push_back({i + 1, geometry::quaternion_from_rotation(pose.rotation), pose.translation, 1,
                      concat("cam", i, "/000.png")});
  }
  imaging::write_image(room / "images/000.png", test::noise_image(0));
  test::save_model(room / "sparse/0", test::binary_model(kCamera, images, {0, 0, 4}));
  CHECK_THROWS_NAMING(DataError, load_dataset(dataset_at(room)), "cam0/000.png", "cam1/000.png");
}

TEST_CASE("colmap scene: an image listed twice is named", "[data]") {
  const test::TempDir folder;
  write_colmap_scene(folder / "room", kCamera);
  const io::ColmapModel model = io::read_colmap(folder / "room/sparse/0");
  std::vector<io::ColmapImage> images = model.images;
  images.push_back(images.front());
  images.back().id = 99;
  test::save_model(folder / "room/sparse/0", test::binary_model(kCamera, images, {0, 0, 4}));
  CHECK_THROWS_NAMING(DataError, load_dataset(dataset_at(folder / "room")), "img_0", "one entry",
                      "found two");
}

TEST_CASE("colmap scene: a principal point far from the middle is one warning", "[data]") {
  const test::TempDir folder;
  const auto warnings_at = [&](double cx, double cy) {
    write_colmap_scene(folder / "room",
                       {1, "PINHOLE", test::kWidth, test::kHeight, {25, 25, cx, cy}});
    std::vector<std::string> warnings;
    load_dataset(dataset_at(folder / "room"), &warnings);
    return warnings;
  };
  CHECK(warnings_at(0.4 * test::kWidth, 0.6 * test::kHeight).empty());
  const auto corner = warnings_at(0, 0);
  REQUIRE(corner.size() == 1);
  CHECK_THAT(corner[0], test::naming("(0, 0)", "8 of 8 frames", "cropped"));
  CHECK(warnings_at(0.25 * test::kWidth, 0.5 * test::kHeight).size() == 1);
}

TEST_CASE("colmap scene: a folder above the data set, and foreign cameras, are told", "[data]") {
  const test::TempDir folder;
  write_colmap_scene(folder / "dense/0", kCamera);
  CHECK_THROWS_NAMING(DataError, load_dataset(dataset_at(folder.path())), "not a known kind",
                      "dense/0 is one");
  // Undistorted or distorted models of images that lie above their folder.
  write_colmap_scene(folder / "gs/distorted", kCamera);
  fs::rename(folder / "gs/distorted/images", folder / "gs/images");
  CHECK_THROWS_NAMING(DataError, load_dataset(dataset_at(folder / "gs")),
                      "gs/distorted is one: ", "--set dataset.image_folder=../images");
  fs::rename(folder / "gs/images", folder / "gs/input");
  CHECK_THROWS_NAMING(DataError, load_dataset(dataset_at(folder / "gs")),
                      "--set dataset.image_folder=../input");
  fs::rename(folder / "gs/input", folder / "gs/images");
  DatasetOptions options = dataset_at(folder / "gs/distorted");
  options.image_folder = "../images";
  CHECK(load_dataset(options).train.size() + load_dataset(options).test.size() == 10);
  const fs::path photos = folder / "photos";
  imaging::write_image(photos / "images/a.png", test::noise_image(0));
  write_file(photos / "cameras.xml", "<document/>");
  CHECK_THROWS_NAMING(DataError, load_dataset(dataset_at(photos)), "cameras.xml", "COLMAP");
  write_colmap_scene(folder / "room", kCamera);
  fs::rename(folder / "room/images", folder / "room/input");
  CHECK_THROWS_NAMING(DataError, load_dataset(dataset_at(folder / "room")),
                      "dataset.image_folder=input", "10 images");
}

TEST_CASE("colmap scene: a text model that differs from the binary one is reported", "[data]") {
  const test::TempDir folder;
  const fs::path room = folder / "room";
  for (const double focal : {25, 30}) {
    write_colmap_scene(room, kCamera);
    const io::ColmapModel model = io::read_colmap(room / "sparse/0");
    io::ColmapCamera camera = kCamera;
    camera.parameters[0] = focal;
    test::save_model(room / "sparse/0", test::text_model(camera, model.images, {0, 0, 4}));
    std::vector<std::string> warnings;
    CHECK(load_dataset(dataset_at(room), &warnings).train[0].camera.fx == Approx(25));
    CHECK(test::mentions(warnings, "cameras.txt") == (focal != 25));
  }
}

TEST_CASE("colmap scene: names that differ by ending or capitals are reported with an example",
          "[data]") {
  const test::TempDir folder;
  const fs::path room = folder / "room";
  write_colmap_scene(room, kCamera);
  for (int i = 0; i < 10; ++i) {
    fs::rename(room / concat("images/img_0", i, ".png"), room / concat("images/IMG_0", i, ".PNG"));
  }
  CHECK_THROWS_NAMING(DataError, load_dataset(dataset_at(room)), "img_00.png", "IMG_00.PNG");
}

/// Writes a model of three images, whose names there and whose files in images/ may differ.
template <class Name, class File>
DatasetOptions write_three_images(const fs::path& room, const Name& name, const File& file) {
  std::vector<io::ColmapImage> images;
  for (int i = 0; i < 3; ++i) {
    const geometry::Pose pose = test::steady_pose(1e5 * i);
    images.push_back(
        {i + 1, geometry::quaternion_from_rotation(pose.rotation), pose.translation, 1, name(i)});
    imaging::write_image(room / "images" / file(i), test::noise_image(i));
  }
  test::save_model(room / "sparse/0", test::binary_model(kCamera, images, {0, 0, 4}));
  DatasetOptions options = dataset_at(room);
  options.split = SplitKind::kNone;
  return options;
}

TEST_CASE("colmap scene: names with accents in another form are found, with a warning", "[data]") {
  const test::TempDir folder;
  const fs::path room = folder / "room";
  const DatasetOptions options = write_three_images(
      room, [](int i) { return concat("e\u0301", i, ".png"); },
      [](int i) { return concat("\u00e9", i, ".png"); });
  std::vector<std::string> warnings;
  CHECK(load_dataset(options, &warnings).train.size() == 3);
  REQUIRE(warnings.size() == 1);
  CHECK(test::mentions(warnings, "3 names, such as e\u03010.png"));
}

TEST_CASE("colmap scene: names with the slashes of Windows are found", "[data]") {
  const test::TempDir folder;
  const fs::path room = folder / "room";
  const DatasetOptions options = write_three_images(
      room, [](int i) { return concat("cam", i, "\\a.png"); },
      [](int i) { return concat("cam", i, "/a.png"); });
  std::vector<std::string> warnings;
  const Dataset data = load_dataset(options, &warnings);
  CHECK(warnings.empty());
  REQUIRE(data.train.size() == 3);
  CHECK(test::same_image(data.train[2].blurry, test::noise_image(2)));
}

TEST_CASE(
    "colmap scene: points3D.ply gives the points of a model without any; a missing one is reported",
    "[data]") {
  const test::TempDir folder;
  const fs::path room = folder / "room";
  write_colmap_scene(room, kCamera);
  folder.write("room/sparse/0/points3D.ply",
               "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
               "property float z\nproperty uchar red\nproperty uchar green\n"
               "property uchar blue\nend_header\n1 2 30 255 0 51\n-1 0 40 0 255 0\n");
  CHECK(load_dataset(dataset_at(room)).points.size(0) == 20);
  fs::remove(room / "sparse/0/points3D.bin");
  std::vector<std::string> warnings;
  const Dataset data = load_dataset(dataset_at(room), &warnings);
  CHECK(warnings.empty());
  REQUIRE(data.points.defined());
  CHECK(data.points.equal(torch::tensor({{1.0F, 2.0F, 30.0F}, {-1.0F, 0.0F, 40.0F}})));
  CHECK(data.point_colors[0][2].item<float>() == Approx(0.2));
  fs::remove(room / "sparse/0/points3D.ply");
  CHECK_FALSE(load_dataset(dataset_at(room), &warnings).points.defined());
  REQUIRE(warnings.size() == 1);
  CHECK_THAT(warnings[0], test::naming("points3D", "without them (init.kind)"));
}

TEST_CASE("colmap scene: hold=N of Deblur-NeRF is the split, unless dataset.split is set",
          "[data]") {
  const test::TempDir folder;
  const fs::path room = folder / "room";
  write_colmap_scene(room, kCamera);
  folder.write("room/hold=2", "");
  DatasetOptions options = dataset_at(room);
  const Dataset data = load_dataset(options);
  const size_t count = data.test.size() + data.train.size();
  CHECK(data.test.size() == (count + 1) / 2);
  CHECK_THAT(data.split, Catch::Contains("hold=2"));
  options.split = SplitKind::kLast;
  options.test_last = 1;
  CHECK(load_dataset(options).test.size() == 1);
}

TEST_CASE("colmap scene: masks in a folder that is not read are reported", "[data]") {
  const test::TempDir folder;
  const fs::path room = folder / "room";
  const std::string place = GENERATE(as<std::string>(), "mask", "images/masks");
  CAPTURE(place);
  write_colmap_scene(room, kCamera);
  imaging::write_image(room / place / "img_00.png", test::noise_image(0));
  std::vector<std::string> warnings;
  load_dataset(dataset_at(room), &warnings);
  REQUIRE(warnings.size() == 1);
  CHECK_THAT(warnings[0], Catch::Contains(place + "/ (masks"));
}

}  // namespace
}  // namespace jade::data
