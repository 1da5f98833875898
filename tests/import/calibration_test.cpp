// SPDX-License-Identifier: Apache-2.0
#include "jade/import/calibration.h"

#include "support/catch.h"

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "support/temp_dir.h"

using namespace jade;
using geometry::LensModel;

namespace {

// The form of kalibr_calibrate_cameras' camchain; the figures are ours.
const char* const kKalibr = R"(cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0002, -0.0001]
  distortion_model: radtan
  intrinsics: [461.6, 460.3, 362.7, 248.1]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [0.9999, -0.0023, -0.0003, -0.11]
  - [0.0023, 0.9999, -0.0140, 0.0004]
  - [0.0003, 0.0140, 0.9999, -0.0008]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [0.01, -0.02, 0.03, -0.04]
  distortion_model: equidistant
  intrinsics: [457.6, 456.1, 379.9, 255.2]
  resolution: [640, 480]
)";

const char* const kOpenCv = R"(%YAML:1.0
---
image_width: 346
image_height: 260
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 2.5e+02, 0., 170., 0., 2.51e+02, 128.5, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ -0.36, 0.15, 0.001, -0.002, 0.01 ]
)";

struct File {
  test::TempDir folder;
  std::filesystem::path path;
  explicit File(const std::string& text) : path(folder / "calibration") { write_file(path, text); }
};

import::Calibration read(const std::string& text){return import::read_calibration(File(text).path);
}  // namespace

std::string without(std::string text, const std::string& part, const std::string& instead = "") {
  const size_t at = text.find(part);
  REQUIRE(at != std::string::npos);
  return text.replace(at, part.size(), instead);
}

/// The message is one line and names what it must.
void check_fails(const std::string& text, const std::string& part) {
  try {
    read(text);
    FAIL("no error for " << part);
  } catch (const DataError& error) {
    const std::string message = error.what();
    CHECK_THAT(message, Catch::Contains(part));
    CHECK(message.find('\n') == std::string::npos);
  }
}

}  // namespace

TEST_CASE("calibration: a chain of Kalibr, two lenses and the place between", "[import]") {
  const auto calibration = read(kKalibr);
  REQUIRE(calibration.cameras.size() == 2);
  const auto& first = calibration.cameras[0];
  CHECK((first.fx == 461.6 && first.fy == 460.3 && first.cx == 363.2 && first.cy == 248.6));
  CHECK((first.width == 752 && first.height == 480));
  CHECK((first.lens.model == LensModel::kRadialTangential && first.lens.k1 == -0.28 &&
         first.lens.k2 == 0.07 && first.lens.p1 == 0.0002 && first.lens.p2 == -0.0001));
  const auto& second = calibration.cameras[1];
  CHECK((second.lens.model == LensModel::kFisheye && second.lens.k1 == 0.01 &&
         second.lens.k2 == -0.02 && second.lens.k3 == 0.03 && second.lens.k4 == -0.04));
  REQUIRE(calibration.second_from_first);
  CHECK(calibration.second_from_first->translation == geometry::Vector3{-0.11, 0.0004, -0.0008});
  CHECK(calibration.second_from_first->rotation[7] == Approx(0.0140).margin(1e-4));
}

TEST_CASE("calibration: OpenCV's storage, five coefficients or eight", "[import]") {
  const auto camera = read(kOpenCv).cameras.at(0);
  CHECK((camera.fx == 250 && camera.fy == 251 && camera.cx == 170.5 && camera.cy == 129));
  CHECK((camera.width == 346 && camera.height == 260));
  CHECK((camera.lens.model == LensModel::kRadialTangential && camera.lens.k3 == 0.01));
  const auto eight = read(without(kOpenCv, "0.01 ]", "0.01, 0.1, 0.2, 0.3 ]")).cameras.at(0);
  CHECK(
      (eight.lens.model == LensModel::kRational && eight.lens.k3 == 0.01 && eight.lens.k6 == 0.3));
  const auto fisheye =
      read(without(kOpenCv, ", 0.01 ]", " ]") + "distortion_model: fisheye\n").cameras.at(0);
  CHECK((fisheye.lens.model == LensModel::kFisheye && fisheye.lens.k4 == -0.002));
}

TEST_CASE("calibration: calib.txt of RPG fits any size its centre lies in", "[import]") {
  const auto calibration = read("199.1 198.8 132.2 110.7 -0.368 0.151 -0.0003 -0.0008 0.0\n");
  CHECK(calibration.cameras.at(0).lens.p2 == -0.0008);
  const auto camera = import::camera_of(calibration, 0, 240, 180, "frames");
  CHECK((camera.pinhole().cx == Approx(132.7) && camera.pinhole().width == 240));
  CHECK_THROWS_AS(import::camera_of(calibration, 0, 120, 90, "frames"), DataError);
  CHECK_THROWS_WITH(import::camera_of(read("199 198 0 110 0 0 0 0 0"), 0, 240, 180, "frames"),
                    Catch::Contains("calibration: expected a principal point inside 240x180"));
  CHECK_THROWS_AS(import::camera_of(read("199 198 132 179 0 0 0 0 0"), 0, 240, 180, "frames"),
                  DataError);
  CHECK(read("199 198 132 110 0 0 0 0 0").cameras.at(0).lens.model == LensModel::kPinhole);
}

TEST_CASE("calibration: another size than the recording's is refused", "[import]") {
  const auto calibration = read(kOpenCv);
  CHECK(import::camera_of(calibration, 0, 346, 260, "frames").pinhole().fx == 250);
  CHECK_THROWS_WITH(import::camera_of(calibration, 0, 640, 480, "frames"),
                    Catch::Contains("calibrated at 346x260, the frames have 640x480"));
  CHECK_THROWS_WITH(import::camera_of(calibration, 1, 346, 260, "events"),
                    Catch::Contains("a camera 1 for the events"));
}

TEST_CASE("calibration: what is missing or unknown is named in one line", "[import]") {
  check_fails(without(kKalibr, "intrinsics"), "cam0.intrinsics: expected [fx, fy, cx, cy]");
  check_fails(without(kKalibr, "T_cn_cnm1", "T_other"), "cam1.T_cn_cnm1");
  check_fails(without(kKalibr, "radtan", "fov"), "found 'fov'");
  check_fails(without(kKalibr, "pinhole", "omni"), "found 'omni'");
  check_fails(without(kKalibr, "[752, 480]", "[752]"), "found 1 numbers");
  check_fails(without(kKalibr, "461.6", "wide"), "expected a number, found 'wide'");
  check_fails(without(kOpenCv, "image_width", "width"), "image_width");
  check_fails(without(kOpenCv, "distortion_coefficients", "d"), "distortion_coefficients");
  check_fails(without(kOpenCv, ", 0.01 ]", ", 0.01, 0.1 ]"), "found 6");
  check_fails("199 198 132 110\n", "found 4 numbers");
  check_fails("", "none of these");
  check_fails("a: [1, 2\n", "not valid YAML");
  CHECK_THROWS_AS(import::read_calibration("no/such/file"), DataError);
}
