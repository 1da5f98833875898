// SPDX-License-Identifier: Apache-2.0
#include "jade/io/colmap.h"

#include "support/catch.h"

#include <limits>
#include <torch/types.h>
#include <utility>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "support/colmap_writer.h"
#include "support/naming.h"
#include "support/temp_dir.h"

namespace jade::io {
namespace {

const ColmapCamera kCamera{1, "PINHOLE", 20, 10, {15, 16, 10, 5}};

std::vector<ColmapImage> two_images() {
  return {{1, {1, 0, 0, 0}, {0.5, 0.25, -2}, 1, "0_0.png"},
          {2, {0.6, 0, 0.8, 0}, {0, 1, 0}, 1, "with space.png"}};
}

const std::vector<double> kPoints = {0, 1, 2, -3, 4.5, 6};

void check_model(const ColmapModel& model) {
  REQUIRE(model.cameras.size() == 1);
  CHECK(model.cameras[0].model == "PINHOLE");
  CHECK(model.cameras[0].width == 20);
  CHECK(model.cameras[0].parameters == kCamera.parameters);
  REQUIRE(model.images.size() == 2);
  CHECK(model.images[0].translation == std::array<double, 3>{0.5, 0.25, -2});
  CHECK(model.images[1].rotation == std::array<double, 4>{0.6, 0, 0.8, 0});
  CHECK(model.images[1].name == "with space.png");
  CHECK(torch::equal(model.points, torch::tensor(kPoints, torch::kFloat64).reshape({2, 3})));
  CHECK(model.point_colors[1][2].item<int>() == 30);
}

TEST_CASE("colmap: binary and text models hold the same cameras, images and points", "[io]") {
  check_model(parse_colmap(test::binary_model(kCamera, two_images(), kPoints)));
  check_model(parse_colmap(test::text_model(kCamera, two_images(), kPoints)));
  const test::TempDir folder;
  CHECK_FALSE(is_colmap_model(folder.path()));
  test::save_model(folder.path(), test::binary_model(kCamera, two_images(), kPoints));
  CHECK(is_colmap_model(folder.path()));
  check_model(read_colmap(folder.path()));
}

TEST_CASE("colmap: points of the other kind of file are read if the model has none", "[io]") {
  const test::TempDir folder;
  const ColmapFiles binary = test::binary_model(kCamera, two_images(), kPoints),
                    text = test::text_model(kCamera, two_images(), kPoints);
  for (const bool is_binary : {true, false}) {
    CAPTURE(is_binary);
    const std::filesystem::path model = folder / (is_binary ? "binary" : "text"),
                                own = model / (is_binary ? "points3D.bin" : "points3D.txt");
    test::save_model(model, is_binary ? binary : text);
    write_file(model / (is_binary ? "points3D.txt" : "points3D.bin"),
               is_binary ? text.points : binary.points);
    write_file(own, is_binary ? std::string(8, '\0') : "# none\n");
    check_model(read_colmap(model));
    std::filesystem::remove(own);
    check_model(read_colmap(model));
  }
}

TEST_CASE("colmap: text with a byte order mark and line ends of Windows is read", "[io]") {
  ColmapFiles files = test::text_model(kCamera, two_images(), kPoints);
  for (std::string* text : {&files.cameras, &files.images, &files.points}) {
    std::string other = "\xEF\xBB\xBF";
    for (const char letter : *text) other += letter == '\n' ? "\r\n" : std::string(1, letter);
    *text = other;
  }
  check_model(parse_colmap(files));
}

TEST_CASE("colmap: a model cut anywhere is a data error, never a crash", "[io]") {
  const ColmapFiles whole = test::binary_model(kCamera, two_images(), kPoints);
  for (size_t size = 0; size < whole.images.size(); ++size) {
    ColmapFiles cut = whole;
    cut.images.resize(size);
    CHECK_THROWS_AS(parse_colmap(cut), DataError);
  }
  for (size_t size = 1; size < whole.points.size(); ++size) {
    ColmapFiles cut = whole;
    cut.points.resize(size);
    CHECK_THROWS_AS(parse_colmap(cut), DataError);
  }
}

TEST_CASE("colmap: counts larger than the file, NaN and contradictions are refused", "[io]") {
  ColmapFiles huge = test::binary_model(kCamera, two_images(), kPoints);
  huge.points.replace(0, 8, std::string(7, '\xff') + '\x7f');
  CHECK_THROWS_WITH(parse_colmap(huge),
                    Catch::Contains("points3D.bin") && Catch::Contains("claims"));

  auto images = two_images();
  images[1].translation[0] = std::numeric_limits<double>::quiet_NaN();
  CHECK_THROWS_AS(parse_colmap(test::binary_model(kCamera, images, kPoints)), DataError);
  images = two_images();
  images[1].rotation = {0, 0, 0, 0};
  CHECK_THROWS_AS(parse_colmap(test::binary_model(kCamera, images, kPoints)), DataError);
  images = two_images();
  images[1].camera_id = 7;
  CHECK_THROWS_WITH(parse_colmap(test::binary_model(kCamera, images, kPoints)),
                    Catch::Contains("camera 7"));
  images = two_images();
  images[1].id = 1;
  CHECK_THROWS_AS(parse_colmap(test::text_model(kCamera, images, kPoints)), DataError);
}

TEST_CASE("colmap: in text an image's observations are a line, be it an empty one", "[io]") {
  ColmapFiles files = test::text_model(kCamera, two_images(), kPoints);
  files.images = "1 1 0 0 0 0 0 0 1 a.png\n1.5 -2 -1 3 4e-1 7\n2 1 0 0 0 1 0 0 1 b.png";
  CHECK(parse_colmap(files).images.size() == 2);
  files.images = "1 1 0 0 0 0 0 0 1 a.png\n2 1 0 0 0 1 0 0 1 b.png\n";
  CHECK_THROWS_WITH(parse_colmap(files), Catch::Contains("images.txt: line 2: expected the "
                                                         "observations of the image before"));
}

TEST_CASE("colmap: cameras of COLMAP 4 are read, later models named", "[io]") {
  ColmapFiles files = test::text_model(kCamera, two_images(), kPoints);
  files.cameras = "1 SIMPLE_DIVISION 64 48 60 32 24 -0.1\n";
  CHECK(parse_colmap(files).cameras[0].parameters.size() == 4);
  files.cameras = "1 EQUIRECTANGULAR 64 48 64 48\n";
  CHECK(parse_colmap(files).cameras[0].model == "EQUIRECTANGULAR");
  files.cameras = "1 TELESCOPE 64 48 60\n";
  CHECK_THROWS_WITH(parse_colmap(files), Catch::Contains("TELESCOPE"));

  const auto binary = [](int32_t model, size_t parameters) {
    ColmapFiles made = test::binary_model(kCamera, two_images(), kPoints);
    made.cameras.clear();
    test::put<uint64_t>(made.cameras, 1);
    test::put<int32_t>(made.cameras, 1);
    test::put<int32_t>(made.cameras, model);
    test::put<uint64_t>(made.cameras, 64);
    test::put<uint64_t>(made.cameras, 48);
    for (size_t i = 0; i < parameters; ++i) test::put(made.cameras, 10.0);
    return made;
  };
  const std::pair<int32_t, size_t> models[] = {{11, 16}, {12, 4}, {13, 5}, {14, 3},
                                               {15, 4},  {16, 6}, {17, 2}};
  for (const auto& [model, parameters] : models) {
    CHECK(parse_colmap(binary(model, parameters)).cameras[0].parameters.size() == parameters);
    CHECK_THROWS_AS(parse_colmap(binary(model, parameters - 1)), DataError);
  }
  CHECK_THROWS_WITH(parse_colmap(binary(18, 4)),
                    Catch::Contains("number 18") && !Catch::Contains("damaged"));
}

TEST_CASE("colmap: images are counted without reading them", "[io]") {
  const test::TempDir folder;
  CHECK(count_colmap_images(folder.path()) == 0);
  test::save_model(folder / "text", test::text_model(kCamera, two_images(), kPoints));
  CHECK(count_colmap_images(folder / "text") == 2);
  ColmapFiles files = test::binary_model(kCamera, two_images(), kPoints);
  test::save_model(folder / "binary", files);
  CHECK(count_colmap_images(folder / "binary") == 2);
  files.images.replace(0, 8, std::string(8, '\xff'));
  test::save_model(folder / "damaged", files);
  CHECK(count_colmap_images(folder / "damaged") < 10);
}

TEST_CASE("colmap: a folder without a model says what was expected", "[io]") {
  const test::TempDir folder;
  CHECK_THROWS_WITH(read_colmap(folder.path()), Catch::Contains("sparse/0"));
}

TEST_CASE("colmap: NaN and infinity are refused with file and row", "[io]") {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  std::vector<ColmapImage> images = two_images();
  images[1].translation[2] = nan;
  std::vector<double> points = kPoints;
  points[4] = std::numeric_limits<double>::infinity();
  CHECK_THROWS_NAMING(DataError, parse_colmap(test::binary_model(kCamera, images, kPoints)),
                      "images.bin", "image 2 of 2", "nan");
  CHECK_THROWS_NAMING(DataError, parse_colmap(test::text_model(kCamera, images, kPoints)),
                      "images.txt", "line 4", "nan");
  CHECK_THROWS_NAMING(DataError, parse_colmap(test::binary_model(kCamera, two_images(), points)),
                      "points3D.bin", "point 2 of 2", "inf");
  CHECK_THROWS_NAMING(DataError, parse_colmap(test::text_model(kCamera, two_images(), points)),
                      "points3D.txt", "line 2", "inf");
  ColmapCamera camera = kCamera;
  camera.parameters[1] = nan;
  CHECK_THROWS_NAMING(DataError, parse_colmap(test::binary_model(camera, two_images(), kPoints)),
                      "cameras.bin", "camera 1", "nan");
  CHECK_THROWS_NAMING(DataError, parse_colmap(test::text_model(camera, two_images(), kPoints)),
                      "cameras.txt", "line 2", "nan");
}

}  // namespace
}  // namespace jade::io
