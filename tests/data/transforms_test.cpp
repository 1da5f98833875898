// SPDX-License-Identifier: Apache-2.0
#include "jade/data/transforms.h"

#include "support/catch.h"

#include <cmath>
#include <filesystem>
#include <torch/types.h>

#include "data/tiny_recording.h"
#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/imaging/image_io.h"
#include "support/naming.h"
#include "support/temp_dir.h"

namespace jade::data {
namespace {

namespace fs = std::filesystem;

DatasetOptions at(const fs::path& folder) {
  DatasetOptions options;
  options.path = folder;
  return options;
}

/// world_from_camera in OpenGL axes, as JSON.
std::string gl_matrix(const geometry::Pose& camera_from_world) {
  const geometry::Pose pose = geometry::inverse(camera_from_world);
  std::string text = "[";
  for (size_t row = 0; row < 3; ++row) {
    const double* r = pose.rotation.data() + 3 * row;
    std::ostringstream line;
    line.precision(17);
    line << "[" << r[0] << "," << -r[1] << "," << -r[2] << "," << pose.translation[row] << "],";
    text += line.str();
  }
  return text + "[0,0,0,1]]";
}

std::string frames_json(const std::string& prefix, const std::string& extension, int count) {
  std::string frames;
  for (int i = 0; i < count; ++i) {
    frames += concat(i == 0 ? "" : ",", "{\"file_path\":\"", prefix, i, extension,
                     "\",\"transform_matrix\":", gl_matrix(test::steady_pose(1e5 * i)), "}");
  }
  return frames;
}

TEST_CASE("transforms: frames of one name in two folders have the folder's before it", "[data]") {
  const test::TempDir folder;
  for (int i = 0; i < 3; ++i) {
    imaging::write_image(folder / concat("a/cam0/", i, ".png"), test::noise_image(i));
    imaging::write_image(folder / concat("b/", i + 1, ".png"), test::noise_image(i));
  }
  fs::create_directories(folder / "room");
  write_file(folder / "room/transforms.json",
             "{\"fl_x\":50,\"w\":42,\"h\":26,\"frames\":[" + frames_json("../a/cam0/", ".png", 3) +
                 ",{\"file_path\":\"../b/1.png\",\"transform_matrix\":" +
                 gl_matrix(test::steady_pose(4e5)) +
                 "},{\"file_path\":\"../b/3.png\",\"transform_matrix\":" +
                 gl_matrix(test::steady_pose(5e5)) + "}]}");
  DatasetOptions options = at(folder / "room");
  options.split = SplitKind::kNone;
  const Dataset data = load_dataset(options);
  std::vector<std::string> names;
  for (const Exposure& exposure : data.train) names.push_back(exposure.name);
  CHECK(names == std::vector<std::string>{"0", "cam0_1", "2", "b_1", "3"});
  const auto folders = named_folders(folder / "room");
  CHECK(folders ==
        std::vector<fs::path>{fs::canonical(folder / "a/cam0"), fs::canonical(folder / "b")});
  CHECK(named_folders(folder / "a").empty());
}

TEST_CASE("transforms: nerfstudio's single file gives cameras and poses", "[data]") {
  const test::TempDir folder;
  fs::create_directories(folder / "room");
  for (int i = 0; i < 3; ++i) {
    imaging::write_image(folder / concat("room/images/f", i, ".png"), test::noise_image(i));
  }
  write_file(folder / "room/transforms.json",
             "{\"fl_x\":50,\"fl_y\":60,\"w\":42,\"h\":26,\"cx\":20,\"cy\":14,\"frames\":[" +
                 frames_json("images/f", ".png", 3) + "]}");
  const Dataset data = load_dataset(at(folder / "room"));
  CHECK(data.kind == DatasetKind::kTransforms);
  REQUIRE(data.test.size() == 1);
  REQUIRE(data.train.size() == 2);
  CHECK(data.train[1].camera.fx == Approx(25));
  CHECK(data.train[1].camera.fy == Approx(30));
  CHECK(data.train[1].camera.cx == Approx(10));
  CHECK(data.train[1].camera.cy == Approx(7));
  CHECK(test::pose_distance(data.train[1].poses[0], test::steady_pose(2e5)) < 1e-9);
}

TEST_CASE("transforms: NeRF-synthetic's pair of files gives its own split", "[data]") {
  const test::TempDir folder;
  fs::create_directories(folder / "room");
  for (int i = 0; i < 3; ++i) {
    imaging::write_image(folder / concat("room/train/r_", i, ".png"), test::noise_image(i));
    imaging::write_image(folder / concat("room/test/r_", i, ".png"), test::noise_image(50 + i));
  }
  const std::string head = "{\"camera_angle_x\":0.8,\"frames\":[";
  write_file(folder / "room/transforms_train.json", head + frames_json("./train/r_", "", 3) + "]}");
  write_file(folder / "room/transforms_test.json", head + frames_json("./test/r_", "", 2) + "]}");
  const Dataset data = load_dataset(at(folder / "room"));
  REQUIRE(data.train.size() == 3);
  REQUIRE(data.test.size() == 2);
  CHECK(test::same_image(data.test[1].image, test::noise_image(51)));
  CHECK(data.train[0].camera.fx == Approx(0.5 * test::kWidth / std::tan(0.4)));
}

TEST_CASE("transforms: frames without an image are left out and told, unless few remain",
          "[data]") {
  const test::TempDir folder;
  fs::create_directories(folder / "room");
  for (int i = 0; i < 10; ++i) {
    imaging::write_image(folder / concat("room/images/f", i, ".png"), test::noise_image(i));
  }
  write_file(folder / "room/transforms.json",
             "{\"fl_x\":50,\"frames\":[" + frames_json("images/f", ".png", 10) + "]}");
  for (const int gone : {0, 3, 4, 5, 9}) {
    fs::remove(folder / concat("room/images/f", gone, ".png"));
  }
  DatasetOptions options = at(folder / "room");
  options.split = SplitKind::kNone;
  std::vector<std::string> warnings;
  const Dataset data = load_dataset(options, &warnings);
  REQUIRE(data.train.size() == 5);
  CHECK(data.train[1].name == "f2");
  CHECK(test::pose_distance(data.train[1].poses[0], test::steady_pose(2e5)) < 1e-9);
  CHECK(test::same_image(data.train[1].blurry, test::noise_image(2)));
  CHECK(test::mentions(warnings, "5 of 10 frames name an image that is not there"));
  CHECK(test::mentions(warnings, "images/f0.png, images/f3.png, images/f4.png and 2 more"));
  fs::remove(folder / "room/images/f1.png");
  CHECK_THROWS_WITH(load_dataset(options),
                    Catch::Contains("6 of 10 frames") && test::naming("half"));

  // Two of three are more than half, but too few for a scene.
  write_file(folder / "room/transforms.json",
             "{\"fl_x\":50,\"frames\":[" + frames_json("images/f", ".png", 3) + "]}");
  imaging::write_image(folder / "room/images/f1.png", test::noise_image(1));
  CHECK_THROWS_WITH(load_dataset(options), Catch::Contains("1 of 3 frames"));
}

TEST_CASE("transforms: each file of NeRF-synthetic's pair may lack a few images", "[data]") {
  const test::TempDir folder;
  fs::create_directories(folder / "room");
  for (int i = 0; i < 5; ++i) {
    imaging::write_image(folder / concat("room/train/r_", i, ".png"), test::noise_image(i));
    imaging::write_image(folder / concat("room/test/r_", i, ".png"), test::noise_image(50 + i));
  }
  const std::string head = "{\"camera_angle_x\":0.8,\"frames\":[";
  write_file(folder / "room/transforms_train.json", head + frames_json("./train/r_", "", 6) + "]}");
  write_file(folder / "room/transforms_test.json", head + frames_json("./test/r_", "", 7) + "]}");
  std::vector<std::string> warnings;
  const Dataset data = load_dataset(at(folder / "room"), &warnings);
  CHECK(data.train.size() == 5);
  CHECK(data.test.size() == 5);
  CHECK(test::mentions(warnings, "transforms_train.json: 1 of 6 frames"));
  CHECK(test::mentions(warnings, "./test/r_5, ./test/r_6"));
}

TEST_CASE("transforms: frames are undistorted by the file's lens or their own", "[data]") {
  const test::TempDir folder;
  const fs::path path = folder / "room/transforms.json";
  fs::create_directories(folder / "room");
  imaging::write_image(folder / "room/a.png", test::noise_image(0));
  const auto load = [&](const std::string& root, const std::string& frame) {
    write_file(path, "{" + root + "\"frames\":[{\"file_path\":\"a.png\"," + frame +
                         "\"transform_matrix\":" + gl_matrix({}) + "}]}");
    DatasetOptions options = at(folder / "room");
    options.split = SplitKind::kNone;
    return load_dataset(options);
  };
  const auto is_straight = [](const Dataset& data) {
    CHECK(data.undistorted == !data.notes.empty());
    return data.undistorted;
  };
  CHECK_FALSE(is_straight(load("\"fl_x\":15,", "")));
  CHECK(is_straight(load("\"fl_x\":15,", "\"k1\":-0.3,")));
  CHECK(is_straight(load("\"fl_x\":15,\"k1\":-0.3,\"k2\":null,", "")));
  CHECK_FALSE(is_straight(load("\"fl_x\":15,\"k1\":-0.3,", "\"k1\":0,")));
  const std::string fisheye = "\"camera_model\":\"OPENCV_FISHEYE\",";
  CHECK(is_straight(load(fisheye + "\"fl_x\":15,", "")));
  CHECK(is_straight(load("\"fl_x\":15,", fisheye)));
  CHECK(is_straight(load("\"fl_x\":15,\"is_fisheye\":true,", "")));
  CHECK_FALSE(is_straight(load(fisheye + "\"fl_x\":500,", "")));
  CHECK(is_straight(load("\"camera_model\":\"FULL_OPENCV\",\"fl_x\":15,\"k4\":0.5,", "")));
  const torch::Tensor mask = load("\"fl_x\":15,", "\"k1\":0.5,").train[0].mask;
  REQUIRE(mask.defined());
  CHECK(mask.sizes() == torch::IntArrayRef({1, test::kHeight, test::kWidth}));
  CHECK_FALSE(mask.all().item<bool>());
  for (const char* camera :
       {"\"camera_model\":\"EQUIRECTANGULAR\",", "\"ftheta_p0\":1,", "\"k4\":0.1,"}) {
    CHECK_THROWS_AS(load(camera, "\"fl_x\":15,"), DataError);
  }
}

TEST_CASE("transforms: numbers that are none, and cameras of another shape, are named", "[data]") {
  const test::TempDir folder;
  const fs::path path = folder / "room/transforms.json";
  imaging::write_image(folder / "room/a.png", test::noise_image(0));
  const auto fails = [&](const std::string& camera, const std::string& part) {
    write_file(path, "{" + camera + "\n\"frames\":[{\"file_path\":\"a.png\",\"transform_matrix\":" +
                         gl_matrix({}) + "}]}");
    CHECK_THROWS_AS(load_dataset(at(folder / "room")), DataError);
    CHECK_THROWS_WITH(load_dataset(at(folder / "room")), Catch::Contains(part));
  };
  fails("\"fl_x\":50,\n\"cx\": NaN,", "NaN in line 2");
  fails("\"fl_x\":50,\"k1\": -Infinity,", "Infinity in line 1");
  fails("\"fl_x\":\"fifty\",", "'fl_x'");
  fails("\"fl_x\":50,\"w\":13,\"h\":21,", "13x21");
  fails("\"camera_angle_x\":0.8,\"w\":13,\"h\":21,", "13x21");
}

TEST_CASE("transforms: frames of two sizes keep their own cameras", "[data]") {
  const test::TempDir folder;
  imaging::write_image(folder / "room/a.png", test::noise_image(0));
  imaging::write_image(folder / "room/b.png", test::noise_image(1).transpose(1, 2).contiguous());
  write_file(
      folder / "room/transforms.json",
      "{\"fl_x\":25,\"w\":21,\"h\":13,\"frames\":[{\"file_path\":\"a.png\",\"transform_matrix\":" +
          gl_matrix({}) + "},{\"file_path\":\"b.png\",\"w\":13,\"h\":21,\"transform_matrix\":" +
          gl_matrix(test::steady_pose(1e5)) + "}]}");
  DatasetOptions options = at(folder / "room");
  options.split = SplitKind::kNone;
  const Dataset data = load_dataset(options);
  REQUIRE(data.train.size() == 2);
  CHECK(data.train[0].camera == geometry::Intrinsics::centred(25, 21, 13));
  CHECK(data.train[1].camera == geometry::Intrinsics::centred(25, 13, 21));
}

TEST_CASE("transforms: focal lengths and sizes that cannot be are data errors", "[data]") {
  const test::TempDir folder;
  fs::create_directories(folder / "room");
  imaging::write_image(folder / "room/a.png", test::noise_image(0));
  const auto fails = [&](const std::string& camera, const std::string& part) {
    write_file(folder / "room/transforms.json",
               "{" + camera + "\"frames\":[{\"file_path\":\"a.png\",\"transform_matrix\":" +
                   gl_matrix({}) + "}]}");
    CHECK_THROWS_WITH(load_dataset(at(folder / "room")), Catch::Contains(part));
  };
  fails("\"fl_x\":50,\"fl_y\":-50,", "frame 0: expected a focal length 'fl_y' above 0, found -50");
  fails("\"fl_x\":50,\"w\":1e30,\"h\":13,", "frame 0: expected 'w' from 0 to 65536 px");
  fails("\"fl_x\":50,\"w\":21,\"h\":-13,", "frame 0: expected 'h' from 0 to 65536 px");
}

TEST_CASE("transforms: damaged JSON, missing images and matrices are data errors", "[data]") {
  const test::TempDir folder;
  fs::create_directories(folder / "room");
  const fs::path path = folder / "room/transforms.json";
  write_file(path, "{\"frames\": [");
  CHECK_THROWS_WITH(load_dataset(at(folder / "room")), Catch::Contains("transforms.json"));
  write_file(path, "{\"fl_x\":50,\"frames\":[" + frames_json("images/f", ".png", 1) + "]}");
  CHECK_THROWS_WITH(load_dataset(at(folder / "room")), Catch::Contains("f0.png"));
  imaging::write_image(folder / "room/a.png", test::noise_image(0));
  write_file(path, "{\"fl_x\":50,\"frames\":[{\"file_path\":\"a.png\"}]}");
  CHECK_THROWS_WITH(load_dataset(at(folder / "room")), Catch::Contains("transform_matrix"));
  write_file(path,
             "{\"fl_x\":50,\"frames\":[{\"file_path\":\"a.png\",\"transform_matrix\":[[1,2]]}]}");
  CHECK_THROWS_WITH(load_dataset(at(folder / "room")), Catch::Contains("transform_matrix"));
  write_file(path,
             "{\"frames\":[{\"file_path\":\"a.png\",\"transform_matrix\":" + gl_matrix({}) + "}]}");
  CHECK_THROWS_WITH(load_dataset(at(folder / "room")), Catch::Contains("camera_angle_x"));
}

/// Ten images images/f0.png to f9.png and a transforms.json with more keys before its frames.
struct Room {
  test::TempDir folder;
  DatasetOptions options;
  std::vector<std::string> warnings;

  explicit Room(const std::string& keys = "", const std::string& prefix = "images/f") {
    for (int i = 0; i < 10; ++i) {
      imaging::write_image(folder / concat("room/images/f", i, ".png"), test::noise_image(i));
    }
    options = at(folder / "room");
    put("transforms.json", keys, frames_json(prefix, ".png", 10));
  }
  void put(const std::string& name, const std::string& keys, const std::string& frames) const {
    write_file(folder / ("room/" + name), "{\"fl_x\":50," + keys + "\"frames\":[" + frames + "]}");
  }
  Dataset load() {
    warnings.clear();
    return load_dataset(options, &warnings);
  }
};

std::vector<std::string> test_names(const Dataset& data) {
  std::vector<std::string> names;
  for (const SharpView& view : data.test) names.push_back(view.name);
  return names;
}

TEST_CASE("transforms: lists of file names are the split", "[data]") {
  Room room(
      R"("train_filenames":["images/f0.png","./images/f1.png","images/f5.png"],)"
      R"("val_filenames":["images/f9.png"],"test_filenames":["images\\f3.png","images/f4.png"],)");
  const Dataset data = room.load();
  CHECK(test_names(data) == std::vector<std::string>{"f3", "f4"});
  CHECK(data.train.size() == 3);
  CHECK_THAT(data.split, Catch::Contains("test_filenames"));
  CHECK(test::mentions(room.warnings, "5 of 10 frames"));
  room.options.split = SplitKind::kLast;
  CHECK(test_names(room.load()).front() == "f5");
  CHECK(test::mentions(room.warnings, "train_filenames"));
}

TEST_CASE("transforms: without test_filenames those of val_filenames test, the rest trains",
          "[data]") {
  Room room(R"("val_filenames":["images/f9.png"],)");
  const Dataset data = room.load();
  CHECK(test_names(data) == std::vector<std::string>{"f9"});
  CHECK(data.train.size() == 9);
  CHECK(room.warnings.empty());
}

TEST_CASE("transforms: a frame for training and for testing tests, names of no frame are refused",
          "[data]") {
  Room both(R"("train_filenames":["images/f0.png","images/f1.png"],)"
            R"("test_filenames":["images/f1.png"],)");
  CHECK(both.load().train.size() == 1);
  CHECK(test::mentions(both.warnings, "test views only"));
  Room unknown(R"("test_filenames":["images/f77.png"],)");
  CHECK_THROWS_WITH(unknown.load(), Catch::Contains("f77.png"));
  Room none(R"("train_filenames":["images/f1.png"],"test_filenames":["images/f1.png"],)");
  CHECK_THROWS_AS(none.load(), DataError);
}

TEST_CASE("transforms: a file of test views beside transforms.json is the split", "[data]") {
  Room room;
  room.put("transforms_test.json", "", frames_json("images/f", ".png", 2));
  CHECK(test_names(room.load()) == std::vector<std::string>{"f0", "f1"});
  CHECK(room.load().train.size() == 8);
  CHECK(test::mentions(room.warnings, "2 of its frames"));
}

TEST_CASE("transforms: transforms_val.json tests where there is no transforms_test.json",
          "[data]") {
  Room room;
  fs::rename(room.folder / "room/transforms.json", room.folder / "room/transforms_train.json");
  room.put("transforms_val.json", "", frames_json("images/f", ".png", 3));
  CHECK(test_names(room.load()) == std::vector<std::string>{"f0", "f1", "f2"});
}

TEST_CASE("transforms: paths of Windows and of another machine are found", "[data]") {
  const std::string prefix =
      GENERATE(as<std::string>(), "images\\\\f", ".\\\\images\\\\f", "C:\\\\a\\\\images\\\\f",
               "/home/me/room/images/f", "room/images/f");
  CAPTURE(prefix);
  Room room("", prefix);
  CHECK(room.load().train.size() + room.load().test.size() == 10);
  CHECK(room.load().train[0].name == "f1");
}

TEST_CASE("transforms: paths escaped as in a URL are found", "[data]") {
  Room room("", "images%2Ff");
  CHECK(room.load().train[0].name == "f1");
  CHECK(room.warnings.empty());
}

TEST_CASE("transforms: names with accents in another form are found, with a warning", "[data]") {
  Room room("", "images/\u00e9");
  for (int i = 0; i < 10; ++i) {
    fs::rename(room.folder / concat("room/images/f", i, ".png"),
               room.folder / concat("room/images/e\u0301", i, ".png"));
  }
  CHECK(room.load().train.size() + room.load().test.size() == 10);
  CHECK(test::mentions(room.warnings, "10 names, such as images/\u00e90"));
  CHECK_FALSE(test::mentions(room.warnings, "no pose"));
}

TEST_CASE("transforms: names that differ by capitals or their ending are reported with an example",
          "[data]") {
  Room room("", "Images/F");
  CHECK_THROWS_NAMING(DataError, room.load(), "Images/F0.png", "images/f0.png", "rename");
  Room ending;
  for (const int i : {3, 4}) {
    const fs::path image = ending.folder / concat("room/images/f", i);
    fs::rename(image.string() + ".png", image.string() + ".bmp");
  }
  CHECK(ending.load().train.size() + ending.load().test.size() == 8);
  CHECK(test::mentions(ending.warnings, "images/f3.bmp"));
}

TEST_CASE("transforms: a frame that is listed twice is used once, with a warning", "[data]") {
  Room room;
  room.put("transforms.json", "",
           frames_json("images/f", ".png", 5) + "," + frames_json("./images/f", "", 2));
  CHECK(room.load().train.size() + room.load().test.size() == 5);
  CHECK(test::mentions(room.warnings, "2 frames are listed twice: ./images/f0, ./images/f1"));
}

TEST_CASE("transforms: an image with two poses is refused by name", "[data]") {
  Room room;
  std::string other = frames_json("./images/f", "", 1);
  other.replace(other.rfind("0,0,0,1"), 7, "0,0,0,1.00001");
  room.put("transforms.json", "", frames_json("images/f", ".png", 5) + "," + other);
  CHECK_THROWS_NAMING(DataError, room.load(), "transforms.json", "./images/f0", "listed twice",
                      "images/f0.png", "other values");
}

TEST_CASE("transforms: ply_file_path gives the points", "[data]") {
  Room room(R"("ply_file_path":"sparse_pc.ply",)");
  room.folder.write("room/sparse_pc.ply",
                    "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
                    "property float z\nproperty uchar red\nproperty uchar green\n"
                    "property uchar blue\nend_header\n1 2 30 255 0 51\n-1 0 40 0 255 0\n");
  const Dataset data = room.load();
  REQUIRE(data.points.defined());
  CHECK(data.points.equal(torch::tensor({{1.0F, 2.0F, 30.0F}, {-1.0F, 0.0F, 40.0F}})));
  CHECK(data.point_colors[0][2].item<float>() == Approx(0.2));
  CHECK(room.warnings.empty());
  fs::remove(room.folder / "room/sparse_pc.ply");
  CHECK_FALSE(room.load().points.defined());
  CHECK(test::mentions(room.warnings, "sparse_pc.ply"));
}

TEST_CASE("transforms: images that no frame names are reported", "[data]") {
  Room room;
  room.put("transforms.json", "", frames_json("images/f", ".png", 4));
  CHECK(room.load().train.size() == 3);
  CHECK(test::mentions(room.warnings, "6 of 10 images"));
  CHECK(test::mentions(room.warnings, "f4.png"));
}

TEST_CASE("transforms: keys that would change the result are named in one warning", "[data]") {
  Room room(R"("scale":0.5,"offset":[0,0,0],"enable_rolling_shutter":true,"is_fisheye":false,)");
  room.load();
  REQUIRE(room.warnings.size() == 1);
  CHECK_THAT(room.warnings[0], Catch::Contains("'scale'") &&
                                   Catch::Contains("'enable_rolling_shutter'") &&
                                   !Catch::Contains("offset") && !Catch::Contains("is_fisheye"));
}

TEST_CASE("transforms: mask_path of a frame is its mask, and must be there", "[data]") {
  Room room;
  const std::string frame = R"({"file_path":"images/f0.png","mask_path":"m\\0.png",)"
                            R"("transform_matrix":)" +
                            gl_matrix({}) + "}";
  room.put("transforms.json", "",
           frame + "," +
               frames_json("images/f", ".png", 10)
                   .substr(frames_json("images/f", ".png", 1).size() + 1));
  CHECK_THROWS_WITH(room.load(), Catch::Contains("mask_path"));
  torch::Tensor mask = torch::ones({1, test::kHeight, test::kWidth});
  mask[0][0][3] = 0;
  imaging::write_image(room.folder / "room/m/0.png", mask);
  room.options.split = SplitKind::kNone;
  const Dataset data = room.load();
  REQUIRE(data.train[0].mask.defined());
  CHECK(data.train[0].mask.equal(mask.to(torch::kBool)));
  CHECK_FALSE(data.train[1].mask.defined());
}

/// A room with one image a.png and a transforms.json with `keys` before its frame.
Dataset load_one(const test::TempDir& folder, const std::string& keys,
                 const std::string& matrix = gl_matrix({})) {
  imaging::write_image(folder / "room/a.png", test::noise_image(0));
  write_file(
      folder / "room/transforms.json",
      "{" + keys + "\"frames\":[{\"file_path\":\"a.png\",\"transform_matrix\":" + matrix + "}]}");
  DatasetOptions options = at(folder / "room");
  options.split = SplitKind::kNone;
  return load_dataset(options);
}

TEST_CASE("transforms: distortion_params is the lens, as the single coefficients are", "[data]") {
  const test::TempDir folder;
  const std::string camera = "\"camera_model\":\"OPENCV\",\"fl_x\":15,";
  const Dataset single =
      load_one(folder, camera + R"("k1":-0.3,"k2":0.1,"k3":0.02,"p1":0.01,"p2":-0.02,)");
  const Dataset list =
      load_one(folder, camera + R"("distortion_params":[-0.3,0.1,0.02,0,0.01,-0.02],)");
  REQUIRE(single.notes.size() == 1);
  CHECK(list.notes == single.notes);
  CHECK(list.train[0].blurry.equal(single.train[0].blurry));
  // nerfstudio uses the list if a file has both.
  const Dataset both =
      load_one(folder, camera + R"("k1":0.5,"distortion_params":[-0.3,0.1,0.02,0,0.01,-0.02],)");
  CHECK(both.train[0].blurry.equal(single.train[0].blurry));
  CHECK_THROWS_NAMING(DataError, load_one(folder, camera + "\"distortion_params\":[-0.3,0.1],"),
                      "distortion_params", "6 numbers", "[-0.3,0.1]");
  CHECK_THROWS_AS(load_one(folder, camera + R"("distortion_params":["a",0,0,0,0,0],)"), DataError);
}

TEST_CASE("transforms: coefficients beside camera_model PINHOLE are used, with a warning",
          "[data]") {
  const test::TempDir folder;
  const auto load = [&](const std::string& model, const std::string& keys,
                        std::vector<std::string>* warnings) {
    load_one(folder, "\"camera_model\":\"" + model + "\",\"fl_x\":15," + keys);
    return load_dataset(at(folder / "room"), warnings);
  };
  std::vector<std::string> warnings, none;
  const Dataset opencv = load("OPENCV", R"("k1":-0.3,"p1":0.01,)", nullptr);
  for (const char* model : {"PINHOLE", "SIMPLE_PINHOLE", "pinhole"}) {
    warnings.clear();
    const Dataset data = load(model, R"("k1":-0.3,"p1":0.01,)", &warnings);
    CHECK(data.train[0].blurry.equal(opencv.train[0].blurry));
    CHECK(test::mentions(warnings, "PINHOLE"));
    CHECK(test::mentions(warnings, "k1"));
  }
  CHECK(load("PINHOLE", R"("k1":0,"k2":0.0,)", &none).notes.empty());
  CHECK_FALSE(test::mentions(none, "PINHOLE"));
}

TEST_CASE("transforms: a principal point of 0 gives way to the middle, with a warning", "[data]") {
  const test::TempDir folder;
  for (const bool zero : {true, false}) {
    load_one(folder, zero ? R"("fl_x":15,"cx":0,"cy":0.0,)" : R"("fl_x":15,)");
    std::vector<std::string> warnings;
    const Dataset data = load_dataset(at(folder / "room"), &warnings);
    CHECK(data.train[0].camera.cx == Approx(0.5 * test::kWidth));
    CHECK(test::mentions(warnings, "principal point") == zero);
  }
}

TEST_CASE("transforms: fields of view keep the principal point, and y has its own", "[data]") {
  const test::TempDir folder;
  const auto camera = [&](const std::string& keys) {
    return load_one(folder, keys).train.at(0).camera;
  };
  const double fx = 0.5 * test::kWidth / std::tan(0.4), fy = 0.5 * test::kHeight / std::tan(0.35);
  const auto off_centre = camera(R"("camera_angle_x":0.8,"cx":9,"cy":5,)");
  CHECK(off_centre.fx == Approx(fx));
  CHECK(off_centre.fy == Approx(fx));
  CHECK(off_centre.cx == Approx(9));
  CHECK(off_centre.cy == Approx(5));
  // At twice the size of the image.
  const auto doubled = camera(R"("camera_angle_x":0.8,"w":42,"h":26,"cx":18,"cy":10,)");
  CHECK(doubled.fx == Approx(fx));
  CHECK(doubled.cx == Approx(9));
  const auto two = camera(R"("camera_angle_x":0.8,"camera_angle_y":0.7,)");
  CHECK(two.fx == Approx(fx));
  CHECK(two.fy == Approx(fy));
  CHECK(camera(R"("camera_angle_y":0.7,)").fx == Approx(fy));
  const auto focal = camera(R"("fl_x":25,"fl_y":26,"camera_angle_x":0.8,"camera_angle_y":0.7,)");
  CHECK(focal.fx == Approx(25));
  CHECK(focal.fy == Approx(26));
  CHECK_THROWS_NAMING(DataError, camera(R"("camera_angle_x":45,)"), "camera_angle_x", "45");
}

TEST_CASE("transforms: fields of view in degrees, and what else may be one is named", "[data]") {
  const test::TempDir folder;
  const auto camera = load_one(folder, R"("x_fov":45.83662361,)").train.at(0).camera;
  CHECK(camera.fx == Approx(0.5 * test::kWidth / std::tan(0.4)));
  CHECK_THROWS_NAMING(DataError, load_one(folder, R"("x_fov":180,)"), "x_fov", "degrees");
  CHECK_THROWS_NAMING(DataError, load_one(folder, R"("fov":60,)"), "x_fov", "found 'fov'");
}

TEST_CASE("transforms: a principal point in fractions or at the border has a warning", "[data]") {
  const test::TempDir folder;
  const auto load = [&](const std::string& keys, std::vector<std::string>* warnings) {
    load_one(folder, keys);
    return load_dataset(at(folder / "room"), warnings).train[0].camera;
  };
  std::vector<std::string> warnings;
  const auto camera = load(R"("fl_x":15,"cx":0.5,"cy":0.6,)", &warnings);
  CHECK(camera.cx == Approx(0.5 * test::kWidth));
  CHECK(camera.cy == Approx(0.6 * test::kHeight));
  CHECK(test::mentions(warnings, "fractions of the image size"));
  for (const char* centre : {"1.4", "-1.4", "20"}) {
    warnings.clear();
    load(concat(R"("fl_x":15,"cx":)", centre, R"(,"cy":6,)"), &warnings);
    CHECK(test::mentions(warnings, "near the middle"));
  }
  warnings.clear();
  load(R"("fl_x":15,"cx":8,"cy":6,)", &warnings);
  CHECK_FALSE(test::mentions(warnings, "principal point"));
}

TEST_CASE("transforms: a focal length and a field of view that differ have a warning", "[data]") {
  const test::TempDir folder;
  for (const bool differs : {true, false}) {
    const double angle = 2 * std::atan(0.5 * test::kWidth / (differs ? 18 : 15));
    load_one(folder, concat(R"("fl_x":15,"camera_angle_x":)", angle, ","));
    std::vector<std::string> warnings;
    CHECK(load_dataset(at(folder / "room"), &warnings).train[0].camera.fx == Approx(15));
    CHECK(test::mentions(warnings, "expected one focal length") == differs);
  }
}

TEST_CASE("transforms: null is no mask, UTF-16 and cropped images are named", "[data]") {
  const test::TempDir folder;
  load_one(folder, R"("fl_x":25,)");
  const fs::path file = folder / "room/transforms.json";
  std::string text = read_file(file);
  text.insert(text.find("\"transform_matrix"), "\"mask_path\":null,");
  write_file(file, text);
  CHECK_FALSE(load_dataset(at(folder / "room")).train[0].mask.defined());
  const Dataset data = load_one(folder, R"("fl_x":25,"w":23,"h":14,)");
  REQUIRE(data.notes.size() == 1);
  CHECK_THAT(data.notes[0], test::naming("23x14", "21x13", "cropped"));
  CHECK(load_one(folder, R"("fl_x":25,"w":43,"h":27,)").notes.empty());
  std::string wide = "\xFF\xFE";
  for (const char c : text) wide += {c, '\0'};
  for (const std::string& bytes : {wide, wide.substr(2)}) {
    write_file(file, bytes);
    CHECK_THROWS_NAMING(DataError, load_dataset(at(folder / "room")), "UTF-16", "iconv");
  }
}

TEST_CASE("transforms: cameras that no image can have are refused by what was found", "[data]") {
  const test::TempDir folder;
  CHECK_THROWS_NAMING(DataError, load_one(folder, "\"fl_x\":-25,"), "'fl_x' above 0", "-25");
  CHECK_THROWS_NAMING(DataError, load_one(folder, R"("fl_x":25,"cx":640,"cy":6,)"),
                      "principal point", "21x13", "640");
  CHECK_THROWS_NAMING(DataError, load_one(folder, "\"fl_x\":25000,"), "focal lengths", "25000");
  CHECK_THROWS_NAMING(DataError, load_one(folder, "\"fl_x\":0.05,"), "focal lengths", "0.05");
}

TEST_CASE("transforms: what is wrong with a matrix is said", "[data]") {
  const test::TempDir folder;
  const auto load = [&](const std::string& matrix) {
    return load_one(folder, "\"fl_x\":25,", matrix);
  };
  CHECK_THROWS_NAMING(DataError, load("[[1,0,0,0],[0,1,0,0],[0,0,1,0],[2,3,4,1]]"), "last row",
                      "[2,3,4,1]", "transposed");
  CHECK_THROWS_NAMING(DataError, load("[[1,0,0,5],[0,1,0,0],[0,0,1,0],[0,0,0,0]]"), "last row",
                      "[0,0,0,0]");
  CHECK_THROWS_NAMING(DataError, load("[[1,0,0,5],[0,1,0,0],[0,0,1,0],[0,0,1]]"), "[0,0,1]");
  CHECK(load("[[1,0,0,5],[0,1,0,0],[0,0,1,0]]").train.size() == 1);
  CHECK(load("[[1,0,0,5],[0,1,0,0],[0,0,1,0],[0,0,0,1.0000001]]").train.size() == 1);
  CHECK_THROWS_NAMING(DataError, load("[[-1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"), "mirrored",
                      "negate");
  CHECK_THROWS_NAMING(DataError, load("[[2,0,0,0],[0,2,0,0],[0,0,2,0],[0,0,0,1]]"), "scaled by 2",
                      "divide");
  CHECK_THROWS_NAMING(DataError, load("[[0,0,0,0],[0,0,0,0],[0,0,0,0],[0,0,0,1]]"), "determinant 0",
                      "remove");
  CHECK_THROWS_NAMING(DataError, load("[[1,0,0],[0,1,0],[0,0,1]]"), "found [1,0,0]");
}

TEST_CASE("transforms: dataset.image_folder names smaller images of the same names", "[data]") {
  const std::string size = GENERATE(as<std::string>(), "", "\"w\":21,\"h\":13,");
  CAPTURE(size);
  Room room(size + "\"cx\":9,");
  for (int i = 0; i < 10; ++i) {
    imaging::write_image(room.folder / concat("room/images_2/f", i, ".png"),
                         torch::full({3, 7, 11}, 0.05 + 0.09 * i));
  }
  room.options.image_folder = "images_2";
  const Dataset data = room.load();
  CHECK(room.warnings.empty());
  REQUIRE(data.train.size() == 8);
  CHECK(data.train[0].blurry.size(2) == 11);
  CHECK(data.train[0].camera.width == 11);
  CHECK(data.train[0].camera.fx == Approx(50.0 * 11 / 21));
  CHECK(data.train[0].camera.cx == Approx(9.0 * 11 / 21));
  room.options.image_folder = "images_4";
  CHECK_THROWS_NAMING(DataError, room.load(), "images_4", "dataset.image_folder");
  room.options.image_folder = "images_2";
  for (int i = 0; i < 8; ++i) fs::remove(room.folder / concat("room/images_2/f", i, ".png"));
  CHECK_THROWS_NAMING(DataError, room.load(), "8 of 10 frames", "images_2/");
}

TEST_CASE("transforms: masks that a frame names in mask/ are in use", "[data]") {
  Room room;
  torch::Tensor mask = torch::ones({1, test::kHeight, test::kWidth});
  mask[0][0][3] = 0;
  imaging::write_image(room.folder / "room/mask/0.png", mask);
  room.load();
  CHECK(test::mentions(room.warnings, "mask/ (masks"));
  room.put("transforms.json", "",
           R"({"file_path":"images/f0.png","mask_path":"mask/0.png","transform_matrix":)" +
               gl_matrix({}) + "}," +
               frames_json("images/f", ".png", 10)
                   .substr(frames_json("images/f", ".png", 1).size() + 1));
  room.load();
  CHECK_FALSE(test::mentions(room.warnings, "mask/ (masks"));
}

}  // namespace
}  // namespace jade::data
