// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/image_header.h"

#include "support/catch.h"

#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "support/temp_dir.h"

namespace jade::imaging {
namespace {

cv::Mat sheet(int channels) { return {7, 11, CV_8UC(channels), cv::Scalar(10, 20, 30, 40)}; }

TEST_CASE("image header: every format says its size and whether it has alpha", "[imaging]") {
  const test::TempDir folder;
  const std::string name = GENERATE("a.png", "a.jpg", "a.tiff", "a.bmp", "a.webp", "a.ppm");
  CAPTURE(name);
  REQUIRE(cv::imwrite((folder / name).string(), sheet(3)));
  const auto header = read_image_header(folder / name);
  REQUIRE(header.has_value());
  CHECK(header->width == 11);
  CHECK(header->height == 7);
  CHECK_FALSE(header->has_alpha);
  if (name == "a.jpg" || name == "a.bmp" || name == "a.ppm") return;
  REQUIRE(cv::imwrite((folder / name).string(), sheet(4), {cv::IMWRITE_WEBP_QUALITY, 101}));
  const auto with_alpha = read_image_header(folder / name);
  REQUIRE(with_alpha.has_value());
  CHECK(with_alpha->has_alpha);
  CHECK(with_alpha->width == 11);
  CHECK(with_alpha->height == 7);
}

/// A JPEG whose EXIF data have one tag, in either byte order.
std::string jpeg_with_exif(const std::string& tag, bool big_endian) {
  const std::string tiff = big_endian ? std::string("MM\0*\0\0\0\x08\0\x01", 10)
                                      : std::string("II*\0\x08\0\0\0\x01\0", 10);
  const std::string exif = std::string("Exif\0\0", 6) + tiff + tag;
  std::vector<uint8_t> jpeg;
  cv::imencode(".jpg", sheet(3), jpeg);
  return "\xFF\xD8\xFF\xE1" + std::string(1, '\0') + char(exif.size() + 2) + exif +
         std::string(jpeg.begin() + 2, jpeg.end());
}

TEST_CASE("image header: a JPEG says its EXIF orientation", "[imaging]") {
  const test::TempDir folder;
  const auto orientation = [&](const std::string& tag, bool big_endian) {
    const auto header = read_image_header(folder.write("a.jpg", jpeg_with_exif(tag, big_endian)));
    REQUIRE(header.has_value());
    CHECK(header->width == 11);
    return header->orientation;
  };
  CHECK(orientation(std::string("\x01\x12\0\x03\0\0\0\x01\0\x06\0\0", 12), true) == 6);
  CHECK(orientation(std::string("\x12\x01\x03\0\x01\0\0\0\x03\0\0\0", 12), false) == 3);
  // Another tag, an orientation that does not exist, and a tag cut short.
  CHECK(orientation(std::string("\x01\x0F\0\x03\0\0\0\x01\0\x06\0\0", 12), true) == 1);
  CHECK(orientation(std::string("\x01\x12\0\x03\0\0\0\x01\0\x09\0\0", 12), true) == 1);
  CHECK(orientation(std::string("\x01\x12\0\x03", 4), true) == 1);
}

TEST_CASE("image header: a TIFF says the kind of its values", "[imaging]") {
  const test::TempDir folder;
  const auto kind = [&](int type) {
    cv::imwrite((folder / "a.tiff").string(), cv::Mat(3, 4, type, cv::Scalar(0, 0, 0)),
                {cv::IMWRITE_TIFF_COMPRESSION, 1});
    return read_image_header(folder / "a.tiff")->values;
  };
  CHECK(kind(CV_8UC3) == "uint8");
  CHECK(kind(CV_16U) == "uint16");
  CHECK(kind(CV_32FC3) == "float32");
  CHECK(kind(CV_64F) == "float64");
}

TEST_CASE("image header: a PGM with comments", "[imaging]") {
  const test::TempDir folder;
  const auto header = read_image_header(folder.write("a.pgm", "P5\n# 3 4\n5 6\n255\n"));
  REQUIRE(header.has_value());
  CHECK(header->width == 5);
  CHECK(header->height == 6);
}

TEST_CASE("image header: what is no image, cut short or missing has none", "[imaging]") {
  const test::TempDir folder;
  CHECK_FALSE(read_image_header(folder / "missing.png"));
  CHECK_FALSE(read_image_header(folder.write("text.png", "not an image")));
  CHECK_FALSE(read_image_header(folder.write("cut.png", "\x89PNG\r\n\x1a\n")));
  CHECK_FALSE(read_image_header(folder.write("cut.jpg", "\xFF\xD8\xFF\xE0")));
  CHECK_FALSE(read_image_header(folder.write("cut.tiff", std::string("II*\0\x08\0\0\0", 8))));
}

}  // namespace
}  // namespace jade::imaging
