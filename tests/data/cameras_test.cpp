// SPDX-License-Identifier: Apache-2.0
#include "jade/data/cameras.h"

#include "support/catch.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "data/tiny_recording.h"
#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "support/naming.h"
#include "support/temp_dir.h"

namespace jade::data {
namespace {

TEST_CASE("cameras: position is the camera's centre, rotation has its axes in columns", "[data]") {
  const test::TempDir dir;
  // Right, down, forward are the world's y, z, x.
  const auto path = dir.write(
      "cameras.json",
      R"([{"id":0,"img_name":"left","width":40,"height":30,"fx":50,"fy":60,"position":[1,2,3],
           "rotation":[[0,0,1],[1,0,0],[0,1,0]]},
          {"width":40,"height":30,"fx":50,"cx":19,"cy":14,"position":[0,0,0],
           "rotation":[[1,0,0],[0,1,0],[0,0,1]]}])");
  const std::vector<NamedCamera> cameras = read_cameras(path);
  REQUIRE(cameras.size() == 2);
  CHECK(cameras[0].name == "left");
  CHECK(cameras[0].camera == geometry::Intrinsics{50, 60, 20, 15, 40, 30});
  const geometry::Pose& pose = cameras[0].camera_from_world;
  const geometry::Vector3 centre = geometry::centre(pose);
  const geometry::Vector3 seen = geometry::transform(pose, {1 + 7, 2 + 5, 3 + 6});
  for (size_t a = 0; a < 3; ++a) {
    CHECK(centre[a] == Approx(1.0 + double(a)));
    CHECK(seen[a] == Approx(5.0 + double(a)));
  }
  CHECK(cameras[1].name == "1");
  CHECK(cameras[1].camera == geometry::Intrinsics{50, 50, 19, 14, 40, 30});
}

TEST_CASE("cameras: what is written is read back, and both ways to say a pose agree", "[data]") {
  const test::TempDir dir;
  const geometry::Pose pose = test::steady_pose(7e5);
  const geometry::Intrinsics camera{50, 60, 19, 14, 40, 30};
  write_cameras(dir / "own.json", {{"a", pose, camera}});
  const auto own = read_cameras(dir / "own.json");
  REQUIRE(own.size() == 1);
  CHECK(own[0].name == "a");
  CHECK(own[0].camera == camera);
  CHECK(test::pose_distance(own[0].camera_from_world, pose) < 1e-12);
  // Viewers of 3DGS read the second form, which is whole without the first.
  nlohmann::json list = nlohmann::json::parse(read_file(dir / "own.json"));
  for (const char* const key :
       {"id", "img_name", "width", "height", "position", "rotation", "fx", "fy"}) {
    CHECK(list[0].contains(key));
  }
  list[0].erase("camera_from_world");
  const auto placed = read_cameras(dir.write("placed.json", list.dump()));
  CHECK(placed[0].name == "a");
  CHECK(test::pose_distance(placed[0].camera_from_world, pose) < 1e-9);
  const geometry::Pose world = geometry::inverse(pose);
  std::ostringstream text;
  text.precision(17);
  text << R"({"width":40,"height":30,"fx":50,"cameras":[{"position":[)" << world.translation[0]
       << "," << world.translation[1] << "," << world.translation[2] << R"(],"rotation":[)";
  for (size_t r = 0; r < 3; ++r) {
    text << (r == 0 ? "[" : ",[") << world.rotation[3 * r] << "," << world.rotation[3 * r + 1]
         << "," << world.rotation[3 * r + 2] << "]";
  }
  const auto theirs = read_cameras(dir.write("theirs.json", text.str() + "]}]}"));
  REQUIRE(theirs.size() == 1);
  CHECK(test::pose_distance(theirs[0].camera_from_world, pose) < 1e-9);
  CHECK_THROWS_WITH(read_cameras(dir.write("bare.json", R"([{"width":4,"height":3,"fx":5}])")),
                    Catch::Contains("bare.json") && Catch::Contains("camera_from_world"));
}

TEST_CASE("cameras: two poses of one entry that differ are refused", "[data]") {
  const test::TempDir dir;
  write_cameras(dir / "a.json", {{"a", test::steady_pose(7e5), {50, 60, 19, 14, 40, 30}}});
  const nlohmann::json written = nlohmann::json::parse(read_file(dir / "a.json"));
  const auto read = [&](const nlohmann::json& list) {
    return read_cameras(dir.write("b.json", list.dump()));
  };
  nlohmann::json moved = written, turned = written, half = written;
  moved[0]["position"][1] = moved[0]["position"][1].get<double>() + 0.01;
  turned[0]["rotation"] = {{0, 0, 1}, {1, 0, 0}, {0, 1, 0}};
  half[0].erase("rotation");
  CHECK(read(written).size() == 1);
  for (const auto& list : {moved, turned, half}) {
    CHECK_THROWS_NAMING(DataError, read(list), "b.json", "entry 0", "\"position\"",
                        "\"camera_from_world\"", "remove");
  }
}

TEST_CASE("cameras: values that a render would ignore are refused", "[data]") {
  const test::TempDir dir;
  const std::string pose = R"("camera_from_world":[[1,0,0,0],[0,1,0,0],[0,0,1,0]])";
  const auto read = [&](const std::string& more) {
    return read_cameras(dir.write("own.json", R"([{"fx":5,)" + pose + "," + more + "}]"));
  };
  const std::string size = R"("width":4.0,"height":3)";
  CHECK(read(size + R"(,"k1":0,"distortion":[0,0.0])")[0].camera.width == 4);
  CHECK_THROWS_NAMING(DataError, read(R"("width":240.5,"height":3)"), "own.json", "width", "240.5");
  CHECK_THROWS_NAMING(DataError, read(size + R"(,"k1":0.1)"), "own.json", "k1");
  CHECK_THROWS_NAMING(DataError, read(size + R"(,"distortion":[0,0.1])"), "distortion");
  CHECK_THROWS_NAMING(DataError, read(size + R"(,"position":[0,0,0])"), "camera_from_world",
                      "position");
}

TEST_CASE("cameras: unknown keys are refused by name, in files of 3DGS only misspelt ones",
          "[data]") {
  const test::TempDir dir;
  const std::string own = R"("camera_from_world":[[1,0,0,0],[0,1,0,0],[0,0,1,0]])";
  const std::string theirs = R"("position":[0,0,0],"rotation":[[1,0,0],[0,1,0],[0,0,1]])";
  const std::string size = R"("width":4,"height":3,"fx":5,)";
  const auto read = [&](const std::string& pose, const std::string& more) {
    return read_cameras(dir.write("some.json", "[{" + size + pose + "," + more + "}]"));
  };
  CHECK_THROWS_NAMING(DataError, read(own, R"("widht":100)"), "some.json", "\"widht\"",
                      "\"width\"");
  CHECK_THROWS_NAMING(DataError, read(own, R"("distorsion":[0.1])"), "\"distortion\"");
  CHECK_THROWS_NAMING(DataError, read(own, R"("time":3)"), "\"time\"", "remove it");
  CHECK_THROWS_NAMING(DataError, read(theirs, R"("distorsion":[0.1])"), "\"distortion\"");
  CHECK(read(theirs, R"("id":3,"time":0.5,"weight":1,"mode":"a","same":1)").size() == 1);
  const auto shared = [&](const std::string& more) {
    return read_cameras(dir.write("all.json", "{" + more + R"("cameras":[{)" + size + own + "}]}"));
  };
  CHECK(shared(R"("cx":1.5,)")[0].camera.cx == 1.5);
  CHECK_THROWS_NAMING(DataError, shared(R"("focal":1.5,)"), "\"focal\"");
}

TEST_CASE("cameras: a lens, numbers too many and values of another kind are refused by key",
          "[data]") {
  const test::TempDir dir;
  const auto read = [&](const std::string& entry) {
    return read_cameras(dir.write("own.json", "[{" + entry + "}]"));
  };
  const std::string size = R"("width":4,"height":3,"fx":5,)";
  const std::string pose = R"("camera_from_world":[[1,0,0,0],[0,1,0,0],[0,0,1,0]])";
  CHECK(read(size + pose + R"(,"camera_model":"pinhole","is_fisheye":false,"model":null)").size() ==
        1);
  CHECK(read(size + pose + R"(,"camera_model":"OPENCV","k1":0)").size() == 1);
  for (const char* key : {"camera_model", "model", "camera_type"}) {
    CHECK_THROWS_NAMING(DataError, read(concat(size, pose, ",\"", key, "\":\"OPENCV_FISHEYE\"")),
                        "own.json", key, "OPENCV_FISHEYE");
  }
  CHECK_THROWS_NAMING(DataError, read(size + pose + R"(,"is_fisheye":true)"), "is_fisheye");
  CHECK_THROWS_NAMING(DataError, read(R"("width":"240","height":3,"fx":5,)" + pose),
                      "\"width\" to be a number", "\"240\"");
  CHECK_THROWS_NAMING(DataError, read(size + pose + R"(,"cx":null)"), "\"cx\"", "null");
  CHECK_THROWS_NAMING(DataError, read(size + pose + R"(,"name":7)"), "\"name\"", "7");
  const std::string axes = R"("rotation":[[1,0,0],[0,1,0],[0,0,1]])";
  CHECK_THROWS_NAMING(DataError, read(size + axes + R"(,"position":[0,0,1,9])"),
                      "\"position\" to be 3 numbers", "[0,0,1,9]");
  for (const char* rows :
       {"[[1,0,0,5],[0,1,0,5],[0,0,1,5]]", "[[1,0,0],[0,1,0],[0,0,1],[0,0,0]]", "[[1,0],[0,1]]"}) {
    CHECK_THROWS_NAMING(DataError, read(concat(size, R"("position":[0,0,1],"rotation":)", rows)),
                        "\"rotation\" to be 3x3 numbers", rows);
  }
}

TEST_CASE("cameras: files that are no list of cameras are reported in plain words", "[data]") {
  const test::TempDir dir;
  const auto told = [&](const std::string& text) -> std::string {
    try {
      read_cameras(dir.write("own.json", text));
    } catch (const DataError& error) {
      return error.what();
    }
    return "nothing";
  };
  CHECK_THAT(told(R"({"cameras": [1,)"), test::naming("own.json", "JSON", "end"));
  CHECK_THAT(told(R"({"cameras": [1}, 2)"), test::naming("byte 15 of 18"));
  CHECK_THAT(told(R"({"frames": []})"), test::naming("own.json", "list of cameras"));
  CHECK_THAT(told("3"), test::naming("own.json", "list of cameras"));
  CHECK_THAT(told(R"([{"width": "wide"}])"),
             Catch::Contains("entry 0: ") && !Catch::Contains("json.exception"));
}

TEST_CASE("cameras: what is wrong with a matrix is said", "[data]") {
  const test::TempDir dir;
  const auto load = [&](const std::string& pose) {
    return read_cameras(
        dir.write("own.json", "[{\"width\":4,\"height\":3,\"fx\":5," + pose + "}]"));
  };
  const auto matrix = [&](const std::string& rows) {
    return load("\"camera_from_world\":" + rows);
  };
  CHECK_THROWS_NAMING(DataError, matrix("[[1,0,0,0],[0,1,0,0],[0,0,1,0],[2,3,4,1]]"), "own.json",
                      "entry 0", "camera_from_world", "transposed");
  CHECK_THROWS_NAMING(DataError, matrix("[[2,0,0,0],[0,2,0,0],[0,0,2,0]]"), "scaled by 2");
  CHECK_THROWS_NAMING(DataError, matrix("[[-1,0,0,0],[0,1,0,0],[0,0,1,0]]"), "mirrored");
  CHECK_THROWS_NAMING(DataError, matrix("[[1,0,0],[0,1,0],[0,0,1],[2,3,4]]"), "[1,0,0]");
  CHECK_THROWS_NAMING(DataError, matrix("[[1,0,0,0],[0,1,0,0]]"), "[[1,0,0,0],[0,1,0,0]]");
  CHECK(matrix("[[1,0,0,5],[0,1,0,0],[0,0,1,0],[0,0,0,1]]").size() == 1);
  const auto turned = [&](const std::string& rows) {
    return load("\"position\":[0,0,0],\"rotation\":" + rows);
  };
  CHECK_THROWS_NAMING(DataError, turned("[[1,0,0],[0,1,0],[0,0,-1]]"), "\"rotation\"", "mirrored");
  CHECK_THROWS_NAMING(DataError, turned("[[3,0,0],[0,3,0],[0,0,3]]"), "scaled by 3");
}

TEST_CASE("cameras: a name with a NUL, which ends a file's name early, is refused", "[data]") {
  const test::TempDir dir;
  const auto path = dir.write("own.json",
                              R"([{"name":"a\u0000b","width":4,"height":3,"fx":5,
                                   "position":[0,0,0],"rotation":[[1,0,0],[0,1,0],[0,0,1]]}])");
  CHECK_THROWS_WITH(read_cameras(path), test::naming("entry 0", "name") && test::naming("NUL"));
}

TEST_CASE("cameras: a held-out exposure is found by its name, and in no set", "[data]") {
  Dataset dataset;
  dataset.train.resize(1);
  dataset.train[0].name = "a";
  dataset.held_out.resize(1);
  dataset.held_out[0].name = "b";
  const auto named = dataset_cameras(dataset, CameraSet::kExposure, "b");
  REQUIRE(named.size() == 9);
  CHECK(named.front().name == "b_0");
  const auto all = dataset_cameras(dataset, CameraSet::kExposure, "");
  REQUIRE(all.size() == 9);
  CHECK(all.front().name == "a_0");
  CHECK(dataset_cameras(dataset, CameraSet::kTrain, "").size() == 1);
}

TEST_CASE("cameras: two of one name are refused, as their images would be one file", "[data]") {
  const test::TempDir dir;
  std::vector<NamedCamera> cameras(2);
  for (NamedCamera& camera : cameras) {
    camera.camera.width = 4;
    camera.camera.height = 3;
    camera.camera.fx = camera.camera.fy = 5;
  }
  cameras[0].name = "a";
  cameras[1].name = "b";
  write_cameras(dir / "own.json", cameras);
  CHECK(read_cameras(dir / "own.json").size() == 2);
  cameras[1].name = "a";
  write_cameras(dir / "own.json", cameras);
  CHECK_THROWS_NAMING(DataError, read_cameras(dir / "own.json"), "entry 1", "'a'");
}

}  // namespace
}  // namespace jade::data
