// SPDX-License-Identifier: Apache-2.0
#include "jade/data/frames.h"

#include "support/catch.h"

#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/imaging/image_io.h"
#include "support/naming.h"
#include "support/temp_dir.h"

namespace jade::data {
namespace {

using Names = std::vector<std::string>;

TEST_CASE("frames: names are those of the files, and longer where these are alike", "[data]") {
  CHECK(frame_names({"/d/images/00.png", "/d/images/01.png"}) == Names{"00", "01"});
  CHECK(frame_names({"/d/a/00.png", "/d/b/00.png", "/d/b/01.png"}) == Names{"a_00", "b_00", "01"});
  CHECK(frame_names({"/d/a/00.png", "/d/a/00.jpg"}) == Names{"a_00_png", "a_00_jpg"});
  CHECK(frame_names({"/d/a/03_1.png", "/d/a/03_9.png"}) == Names{"03_1", "03_9"});
}

TEST_CASE("frames: names that would be taken for each other are refused, with both", "[data]") {
  CHECK_THROWS_WITH(frame_names({"/c/a/00.png", "/d/a/00.png"}),
                    Catch::Contains("/d/a/00.png") && test::naming("/c/a/00.png"));
  CHECK_THROWS_NAMING(DataError, frame_names({"/d/a/03.png", "/d/a/03_1.png"}), "/d/a/03_1.png",
                      "'03'");
  CHECK_NOTHROW(frame_names({"/d/a/03.png", "/d/a/03_9.png"}));
  CHECK_THROWS_NAMING(DataError, frame_names({"/d/a/05\xff.png"}), "UTF-8");
  CHECK(frame_names({"/d/a/\xc3\xbc.png"}) == Names{"\xc3\xbc"});
}

TEST_CASE("frames: links that lead nowhere or to themselves are passed over", "[data]") {
  const test::TempDir folder;
  const std::filesystem::path image = folder.write("images_2/00.png", "");
  for (const char* name : {"latest", "images_3", "images_2/01.png", "images_2/cam1"}) {
    std::filesystem::create_symlink(std::filesystem::path(name).filename(), folder / name);
    std::filesystem::create_symlink("missing", folder / concat(name, "_old.png"));
  }
  CHECK(find_image_folder(folder.path(), "", ImageDepth::kNested) == folder / "images_2");
  CHECK(list_images_within(folder / "images_2") == std::vector{image});
}

TEST_CASE("frames: those of a kind that is not read are named", "[data]") {
  const test::TempDir folder;
  CHECK_THROWS_NAMING(DataError, find_image_folder(folder.path(), ""), "found none; set");
  folder.write("images/a.dng", "");
  folder.write("images/b.dng", "");
  CHECK_THROWS_NAMING(DataError, find_image_folder(folder.path(), ""), "2 files .dng", "convert");
}

TEST_CASE("frames: raw mosaics are one warning", "[data]") {
  const test::TempDir folder;
  const torch::Tensor flat = torch::full({3, 12, 16}, 0.5);
  torch::Tensor mosaic = flat.clone();
  mosaic.slice(1, 0, {}, 2).slice(2, 0, {}, 2) *= 0.7;
  mosaic.slice(1, 1, {}, 2).slice(2, 1, {}, 2) *= 0.85;
  std::vector<std::filesystem::path> plain, raw;
  for (int i = 0; i < 3; ++i) {
    plain.push_back(folder / concat("a/", i, ".png"));
    raw.push_back(folder / concat("b/", i, ".png"));
    imaging::write_image(plain.back(), flat * (1 - 0.1 * i));
    imaging::write_image(raw.back(), mosaic * (1 - 0.1 * i));
  }
  std::vector<std::string> lines;
  read_frames(plain, {}, Warnings(&lines));
  CHECK(lines.empty());
  read_frames(raw, {}, Warnings(&lines));
  REQUIRE(lines.size() == 1);
  CHECK_THAT(lines[0], test::naming("raw mosaic", "convert"));
}

TEST_CASE("frames: those that are damaged in part are one warning", "[data]") {
  const test::TempDir folder;
  std::vector<std::string> lines;
  read_frames({folder.write("a.pgm", "P5 2 2 255\nabcd"), folder.write("b.pgm", "P5 2 2 30\n1234"),
               folder.write("c.pgm", "P5 2 2 30\n5678")},
              {}, Warnings(&lines));
  REQUIRE(lines.size() == 1);
  CHECK_THAT(lines[0], test::naming("b.pgm: expected", "30", "1 more"));
}

TEST_CASE("frames: an orientation that is not applied is one warning", "[data]") {
  // A JPEG of 8x8 gray pixels; its EXIF data say that it is upside down.
  const test::TempDir folder;
  std::vector<uint8_t> plain = imaging::encode_jpeg(torch::full({3, 8, 8}, 0.5), 90);
  const std::string exif(
      "\xFF\xE1\0\x1E\x45xif\0\0MM\0*\0\0\0\x08\0\x01"
      "\x01\x12\0\x03\0\0\0\x01\0\x03\0\0",
      32);
  const std::string rest(plain.begin() + 2, plain.end());
  const std::filesystem::path upright = folder.write("a.jpg", "\xFF\xD8" + rest);
  const std::filesystem::path turned = folder.write("b.jpg", "\xFF\xD8" + exif + rest);
  const std::filesystem::path other = folder.write("c.jpg", "\xFF\xD8" + exif + rest);
  std::vector<std::string> lines;
  read_frames({upright}, {}, Warnings(&lines));
  CHECK(lines.empty());
  read_frames({upright, turned, other}, {}, Warnings(&lines));
  REQUIRE(lines.size() == 1);
  CHECK_THAT(lines[0], test::naming("b.jpg", "1 more", "orientation", "3"));
}

}  // namespace
}  // namespace jade::data
