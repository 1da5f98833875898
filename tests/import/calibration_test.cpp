// SPDX-License-Identifier: Apache-2.0
#include "jade/import/calibration.h"

#include "support/catch.h"

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "support/naming.h"
#include "support/temp_dir.h"

using namespace jade;
using geometry::LensModel;

namespace {

// The format of kalibr_calibrate_cameras' camchain, with invented numbers.
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

/// The message is one line and contains the required words.
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

TEST_CASE("calibration: a fault is said without a remedy", "[import]") {
  CHECK(import::calibration_fault(File(kKalibr).path).empty());
  const std::string fault = import::calibration_fault(File("made: 2024\n").path);
  CHECK(fault.rfind(": expected a calibration", 0) == 0);
  CHECK(fault.find(';') == std::string::npos);
}

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
  CHECK(calibration.unused.empty());
}

TEST_CASE("calibration: further cameras of a chain are listed, not read", "[import]") {
  const std::string more = "\ncam2:\n  camera_model: omni\ncam13:\n  camera_model: pinhole\n";
  const auto calibration = read(kKalibr + more + "camera_notes:\n  by: hand\n");
  CHECK(calibration.cameras.size() == 2);
  CHECK(calibration.unused == std::vector<std::string>{"cam2", "cam13"});
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

TEST_CASE("calibration: every key that means fisheye is honoured", "[import]") {
  const std::string four = without(kOpenCv, ", 0.01 ]", " ]");
  for (const char* line :
       {"fisheye_model: 1", "use_fisheye_model: true", "distortion_model: kannala_brandt",
        "distortion_model: equidistant", "camera_model: fisheye", "Fisheye: 1"}) {
    INFO(line);
    CHECK(read(four + line + "\n").cameras.at(0).lens.model == LensModel::kFisheye);
  }
  for (const char* line : {"fisheye_model: 0", "distortion_model: radtan", "camera_model: pinhole",
                           "camera_model: DAVIS346"}) {
    INFO(line);
    CHECK(read(four + line + "\n").cameras.at(0).lens.model == LensModel::kRadialTangential);
  }
  CHECK(read(four + "distortion_model: none\n").cameras.at(0).lens.model == LensModel::kPinhole);
  check_fails(four + "distortion_model: fov\n", "found 'fov'");
  check_fails(four + "camera_model: omni\n", "found 'omni'");
  check_fails(four + "fisheye_model: maybe\n", "found 'maybe'");
  check_fails(four + "fisheye_model: 1\ndistortion_model: plumb_bob\n", "plumb_bob");
}

TEST_CASE("calibration: other spellings of OpenCV's keys", "[import]") {
  const auto spelled = [](const char* matrix, const char* lens) {
    return without(without(kOpenCv, "camera_matrix", matrix), "distortion_coefficients", lens);
  };
  const std::string capitals = without(
      without(spelled("Camera_Matrix", "Distortion_Coefficients"), "image_width", "image_Width"),
      "image_height", "image_Height");
  for (const std::string& text :
       {capitals, spelled("cameraMatrix", "distCoeffs"), spelled("K", "D"), spelled("M1", "D1"),
        without(without(capitals, "image_Width: 346\n"), "image_Height: 260",
                "image_size: [346, 260]")}) {
    INFO(text);
    const auto camera = read(text).cameras.at(0);
    CHECK((camera.fx == 250 && camera.width == 346 && camera.height == 260));
    CHECK(camera.lens.k3 == 0.01);
  }
  check_fails(spelled("M1", "D1") + "M2: [1, 0, 0, 0, 1, 0, 0, 0, 1]\nD2: [0, 0, 0, 0]\n",
              "found M1 and M2");
  check_fails(
      "intrinsics:\n  cam0:\n    camera_matrix: [1, 1, 1, 1]\n  camRect0:\n    camera_matrix: [1, "
      "1, "
      "1, 1]\n",
      "DSEC with the cameras cam0, camRect0");
}

TEST_CASE("calibration: calib.txt of RPG fits any size its centre lies in", "[import]") {
  const auto calibration = read("199.1 198.8 132.2 110.7 -0.368 0.151 -0.0003 -0.0008 0.0\n");
  CHECK(calibration.cameras.at(0).lens.p2 == -0.0008);
  CHECK(read("\xEF\xBB\xBF"
             "199.1 198.8 132.2 110.7 0 0 0 0 0\r\n")
            .cameras.at(0)
            .fx == 199.1);
  const auto camera = import::camera_of(calibration, 0, 240, 180, "frames");
  CHECK((camera.pinhole().cx == Approx(132.7) && camera.pinhole().width == 240));
  CHECK_THROWS_AS(import::camera_of(calibration, 0, 120, 90, "frames"), DataError);
  CHECK_THROWS_NAMING(DataError,
                      import::camera_of(read("199 198 0 110 0 0 0 0 0"), 0, 240, 180, "frames"),
                      "calibration", "principal point", "240x180");
  CHECK_THROWS_AS(import::camera_of(read("199 198 132 179 0 0 0 0 0"), 0, 240, 180, "frames"),
                  DataError);
  CHECK(read("199 198 132 110 0 0 0 0 0").cameras.at(0).lens.model == LensModel::kPinhole);
}

TEST_CASE("calibration: comments are skipped, and focal lengths of no camera refused", "[import]") {
  const auto camera =
      read("# fx fy cx cy k1 k2 p1 p2 k3\n199 198 132 110 -0.3 0 0 0 0 # of 2024\n").cameras.at(0);
  CHECK((camera.fx == 199 && camera.lens.k1 == -0.3));
  const auto with = [&](const std::string& focal) {
    import::camera_of(read(focal + " 132 110 0 0 0 0 0"), 0, 240, 180, "frames");
  };
  for (const char* focal : {"290000 290000", "2 2", "199 900"})
    CHECK_THROWS_NAMING(DataError, with(focal), "focal lengths", "240x180");
  CHECK_NOTHROW(with("2000 2000"));
}

TEST_CASE("calibration: a 3x3 matrix in text is a pinhole", "[import]") {
  for (const char* text : {"60 0 31.5\n0 61 23.5\n0 0 1\n", "60 0 31.5 0\n0 61 23.5 0\n0 0 1 0\n",
                           "[[60., 0., 31.5],\n [0., 61., 23.5],\n [0., 0., 1.]]\n",
                           "60,0,31.5\n0,61,23.5\n0,0,1\n"}) {
    CAPTURE(text);
    const auto camera = import::camera_of(read(text), 0, 64, 48, "frames");
    CHECK((camera.pinhole().fx == 60 && camera.pinhole().fy == 61));
    CHECK((camera.pinhole().cx == 32 && camera.pinhole().cy == 24));
    CHECK(camera.lens().model == LensModel::kPinhole);
  }
  CHECK_THROWS_NAMING(DataError, read("60 3 31.5\n0 61 23.5\n0 0 1\n"), "3x3", "skew");
}

TEST_CASE("calibration: another size than the recording's is refused", "[import]") {
  const auto calibration = read(kOpenCv);
  CHECK(import::camera_of(calibration, 0, 346, 260, "frames").pinhole().fx == 250);
  CHECK_THROWS_NAMING(DataError, import::camera_of(calibration, 0, 640, 480, "frames"), "346x260",
                      "frames", "640x480");
  CHECK_THROWS_NAMING(DataError, import::camera_of(calibration, 1, 346, 260, "events"), "camera 1",
                      "events");
}

TEST_CASE("calibration: what is missing or unknown is named in one line", "[import]") {
  check_fails(without(kKalibr, "intrinsics"), "cam0.intrinsics: expected [fx, fy, cx, cy]");
  check_fails(without(kKalibr, "T_cn_cnm1", "T_other"), "cam1.T_cn_cnm1");
  check_fails(without(kKalibr, "radtan", "fov"), "found 'fov'");
  check_fails(without(kKalibr, "pinhole", "omni"), "found 'omni'");
  check_fails(without(kKalibr, "[752, 480]", "[752]"), "found 1 numbers");
  check_fails(without(kKalibr, "461.6", "wide"), "expected a number, found 'wide'");
  check_fails(without(kOpenCv, "image_width", "wide"), "image_width");
  check_fails(without(kOpenCv, "distortion_coefficients", "lens"), "distortion_coefficients");
  check_fails(without(kOpenCv, ", 0.01 ]", ", 0.01, 0.1 ]"), "found 6");
  check_fails("199 198 132 110 0\n", "found 5 numbers");
  check_fails("", "empty file");
  check_fails(std::string("\xFF\xFE"
                          "6\0",
                          4),
              "UTF-16");
  check_fails("a: [1, 2\n", "not valid YAML");
  CHECK_THROWS_AS(import::read_calibration("no/such/file"), DataError);
}

TEST_CASE("calibration: camera_info messages of both versions of ROS", "[import]") {
  const std::string ros1 = R"(header:
  seq: 0
height: 180
width: 240
distortion_model: "plumb_bob"
D: [-0.36, 0.15, 0.001, -0.002, 0.01]
K: [199.0, 0.0, 120.0, 0.0, 198.0, 90.0, 0.0, 0.0, 1.0]
R: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
P: [199.0, 0.0, 120.0, 0.0, 0.0, 198.0, 90.0, 0.0, 0.0, 0.0, 1.0, 0.0]
binning_x: 0
binning_y: 0
---
)";
  const auto one = read(ros1).cameras.at(0);
  CHECK((one.fx == 199 && one.fy == 198 && one.cx == 120.5 && one.cy == 90.5));
  CHECK((one.width == 240 && one.height == 180 && one.lens.k3 == 0.01));
  const auto two =
      read(
          "height: 180\nwidth: 240\ndistortion_model: equidistant\nd:\n- 0.1\n- 0.2\n- "
          "0.3\n- 0.4\nk:\n- 199.0\n- 0.0\n- 120.0\n- 0.0\n- 198.0\n- 90.0\n- "
          "0.0\n- 0.0\n- 1.0\n")
          .cameras.at(0);
  CHECK((two.fx == 199 && two.lens.model == LensModel::kFisheye && two.lens.k4 == 0.4));
  CHECK(read(without(ros1, "-0.36, 0.15, 0.001, -0.002, 0.01")).cameras.at(0).lens.model ==
        LensModel::kPinhole);
  check_fails(without(ros1, "199.0, 0.0, 120.0, 0.0, 198.0", "0.0, 0.0, 0.0, 0.0, 0.0"),
              "K: expected a camera matrix, found zeros");
  check_fails(without(ros1, "binning_x: 0", "binning_x: 2"), "binning_x: expected 0 or 1");
  check_fails(without(ros1, "binning_x: 0", "binningX: 2"), "binningX: expected 0 or 1");
  check_fails(without(ros1, "199.0, 0.0, 120.0", "199.0, 3.0, 120.0"), "without skew");
  const auto with_region = [&](const char* values) {
    return without(ros1, "---", std::string("roi:\n  x_offset: ") + values);
  };
  CHECK(read(with_region("0\n  y_offset: 0\n  height: 180\n  width: 240\n")).cameras[0].fx == 199);
  check_fails(with_region("20\n  y_offset: 10\n  height: 100\n  width: 200\n"),
              "roi: expected the whole image, found 200x100 px from (20, 10)");
}

TEST_CASE("calibration: DV's XML, flat or with the camera's section, and its JSON", "[import]") {
  const std::string camera = R"(<camera_matrix type_id="opencv-matrix">
  <rows>3</rows><cols>3</cols><dt>d</dt>
  <data>
    6.98e+02 0. 2.78e+02 0. 6.97e+02
    2.43e+02 0. 0. 1.</data></camera_matrix>
<distortion_coefficients type_id="opencv-matrix">
  <rows>1</rows><cols>5</cols><dt>d</dt>
  <data> -3.39e-01 4.25e-04 2.79e-03 1.42e-03 2.83e-01</data></distortion_coefficients>
<image_width>640</image_width>
<image_height>480</image_height>
)";
  const std::string head = "<?xml version=\"1.0\"?>\n<opencv_storage>\n";
  const std::string tail =
      "<!-- flags -->\n<use_fisheye_model>0</use_fisheye_model>\n"
      "<type>\"camera\"</type></opencv_storage>\n";
  const std::string inside = "<DVXplorer_DXA00080>\n" + camera + "</DVXplorer_DXA00080>\n";
  const std::string json = R"({"version": "2.0", "cameras": {"C0": {"name": "DVXplorer",
    "position": "left", "master": "true", "resolution": ["640", "480"],
    "principalPoint": ["278", "243"], "focalLength": ["698", "697"],
    "distortionCoefficients": ["-3.39e-01", "4.25e-04", "2.79e-03", "1.42e-03", "2.83e-01"],
    "distortionModel": "radialTangential"}}, "imus": {}})";
  for (const std::string& text : {head + camera + tail, head + inside + tail, json}) {
    const auto found = read(text).cameras.at(0);
    CHECK((found.fx == 698 && found.fy == 697 && found.cx == 278.5 && found.cy == 243.5));
    CHECK((found.width == 640 && found.height == 480));
    CHECK((found.lens.model == LensModel::kRadialTangential && found.lens.k3 == 0.283));
  }
  check_fails(head + inside +
                  without(without(inside, "DVXplorer_DXA00080", "Other"), "</DVXplorer_DXA00080",
                          "</Other") +
                  tail,
              "found DVXplorer_DXA00080 and Other");
  check_fails(head + camera, "expected");
  check_fails(without(json, "radialTangential", "fov"), "cameras.C0.distortionModel");
  check_fails("<html><body>no</body></html>", "web page");
}

TEST_CASE("calibration: NaN is refused by name in every form", "[import]") {
  check_fails(without(kKalibr, "461.6", ".nan"), "cam0.intrinsics");
  check_fails(without(kOpenCv, "2.51e+02", "nan"), "camera_matrix");
  check_fails("199 198 132 nan 0 0 0 0 0", "expected cy to be a number, found nan");
  check_fails("199 198 132 110 0 inf 0 0 0", "expected k2");
}

TEST_CASE("calibration: a misspelt key that changes the lens is refused by name", "[import]") {
  const std::string model = "distortion_model: fisheye\n";
  const std::string four = without(kOpenCv, ", 0.01 ]", " ]");
  CHECK(read(four + model).cameras[0].lens.model == LensModel::kFisheye);
  check_fails(four + without(model, "distortion", "distorsion"), "distorsion_model");
  check_fails(four + "Fisheye_modle: 1\n", "fisheyemodel");
  check_fails(four + without(model, "_model", "_modell"), "distortion_modell");
  // Keys of other tools.
  for (const char* more : {"calibration_time: now", "camera_name: left", "binning: 1",
                           "camera_mode: RAW", "lens_mode: wide", "distortion_model0: radtan"}) {
    INFO(more);
    CHECK(read(concat(kOpenCv, more, "\n")).cameras.size() == 1);
  }
  const std::string dv =
      R"({"version": "2.0", "cameras": {"C0": {"focalLength": [300, 300], "principalPoint": [170, 130],
          "resolution": [346, 260], "distortion": [0.1, 0, 0, 0, 0], "distortionModel": "radialTangential"}}})";
  const std::string right = without(dv, "\"distortion\"", "\"distortionCoefficients\"");
  CHECK(read(right).cameras[0].lens.k1 == 0.1);
  check_fails(without(right, "distortionModel", "distorsionModel"), "distorsionModel");
  const std::string unsaid = without(right, ", \"distortionModel\": \"radialTangential\"");
  check_fails(unsaid, "distortionModel");
  CHECK(read(without(unsaid, "[0.1, 0, 0, 0, 0]", "[0, 0, 0, 0, 0]")).cameras.size() == 1);
  CHECK(read(without(unsaid, "[0.1, 0, 0, 0, 0]", "[]")).cameras.size() == 1);
}

TEST_CASE("calibration: Kalibr's report in text is answered with its camchain", "[import]") {
  check_fails(
      "Calibration results\n====================\nCamera-system parameters:\n\tcam0 "
      "(/dvs/image_raw):\n\t type: <class 'aslam_cv'>\n",
      "camchain.yaml");
}

TEST_CASE("calibration: fx fy cx cy alone is a pinhole of any size its centre lies in",
          "[import]") {
  const auto four = read("290 291 119.5 89.5\n");
  CHECK((four.cameras[0].fx == 290 && four.cameras[0].fy == 291 && four.cameras[0].cx == 120));
  CHECK(four.cameras[0].lens.model == LensModel::kPinhole);
  CHECK_NOTHROW(import::camera_of(four, 0, 240, 180, "frames"));
  CHECK_THROWS_AS(import::camera_of(four, 0, 100, 80, "frames"), DataError);
  CHECK_THROWS_AS(import::camera_of(read("0 0 240 180\n"), 0, 240, 180, "frames"), DataError);
}

TEST_CASE("calibration: basalt's JSON of one camera or two", "[import]") {
  const std::string pose = R"({"px": 0.1, "py": 0, "pz": 0, "qx": 0, "qy": 0, "qz": 0, "qw": 1})";
  const std::string turned =
      R"({"px": 0, "py": 0, "pz": 0, "qx": 0, "qy": 0, "qz": 0.7071067811865476, "qw": 0.7071067811865476})";
  const std::string kb4 =
      R"({"camera_type": "kb4", "intrinsics": {"fx": 290, "fy": 291, "cx": 119.5,
      "cy": 89.5, "k1": 0.1, "k2": 0.2, "k3": 0.3, "k4": 0.4}})";
  const std::string radtan =
      R"({"camera_type": "pinhole-radtan8", "intrinsics": {"fx": 290, "fy": 291,
      "cx": 119.5, "cy": 89.5, "k1": 0.1, "k2": 0.2, "p1": 0.01, "p2": 0.02, "k3": 0.3, "k4": 0.4, "k5": 0.5,
      "k6": 0.6, "rpmax": 0}})";
  const auto file = [](const std::string& cameras, const std::string& poses, const char* sizes) {
    return concat(R"({"value0": {"T_imu_cam": [)", poses, R"(], "intrinsics": [)", cameras,
                  R"(], "resolution": [)", sizes, "]}}");
  };
  const auto one = read(file(kb4, pose, "[240, 180]"));
  REQUIRE(one.cameras.size() == 1);
  CHECK((one.cameras[0].fy == 291 && one.cameras[0].cx == 120 && one.cameras[0].width == 240));
  CHECK((one.cameras[0].lens.model == LensModel::kFisheye && one.cameras[0].lens.k4 == 0.4));
  CHECK_FALSE(one.second_from_first);
  const auto two = read(file(kb4 + "," + radtan, pose + "," + turned, "[240, 180], [346, 260]"));
  REQUIRE(two.cameras.size() == 2);
  const geometry::Lens& lens = two.cameras[1].lens;
  CHECK(
      (lens.model == LensModel::kRational && lens.p2 == 0.02 && lens.k3 == 0.3 && lens.k6 == 0.6));
  // The first camera's origin lies at x = 0.1 of the IMU, whose x is -y of the second.
  REQUIRE(two.second_from_first);
  CHECK(two.second_from_first->translation[0] == Approx(0).margin(1e-12));
  CHECK(two.second_from_first->translation[1] == Approx(-0.1));
  check_fails(file(without(kb4, "kb4", "ds"), pose, "[240, 180]"), "found 'ds'");
  check_fails(file(kb4 + "," + radtan, pose + "," + turned, "[240, 180]"), "value0.resolution");
}

TEST_CASE("calibration: sizes, else topics, say which camera of a chain took the frames",
          "[import]") {
  const auto chain = [](const std::string& first, const std::string& second, const char* size) {
    std::string text = without(kKalibr, "rostopic: /cam0/image_raw", first);
    return read(without(text, "resolution: [640, 480]", concat(size, second)));
  };
  const char *same = "resolution: [752, 480]", *other = "resolution: [640, 480]";
  const auto exchanged = [](import::Calibration calibration, const char* part) {
    const double first = calibration.cameras[0].fx;
    const auto pose = *calibration.second_from_first;
    const std::string said = import::put_frames_first(calibration, 752, 480);
    CHECK_THAT(said, Catch::Contains(part));
    if (*part == '\0') CHECK(said.empty());
    const bool changed = calibration.cameras[0].fx != first;
    const auto there_and_back = geometry::compose(*calibration.second_from_first, pose);
    if (changed) CHECK(there_and_back.translation[0] == Approx(0).margin(1e-9));
    return changed;
  };
  // The sizes decide.
  CHECK_FALSE(exchanged(chain("rostopic: /events", "\n  rostopic: /a", other), ""));
  auto swapped = chain("", "", other);
  std::swap(swapped.cameras[0], swapped.cameras[1]);
  CHECK(exchanged(swapped, "by their sizes"));
  // Frames calibrated at another size, with that of the event camera: camera_of() refuses them.
  auto scaled = chain("rostopic: /frames", "\n  rostopic: /events", other);
  std::swap(scaled.cameras[0].width, scaled.cameras[1].width);
  std::swap(scaled.cameras[0].height, scaled.cameras[1].height);
  CHECK_FALSE(exchanged(scaled, ""));
  // Then the topics.
  CHECK(exchanged(chain("rostopic: /dvs/events", "\n  rostopic: /dvs/image_raw", same),
                  "/dvs/events"));
  CHECK(exchanged(chain("rostopic: /dvs/image_raw", "\n  rostopic: /cam1/image", same),
                  "cam1 is taken for the frames; if it is"));
  CHECK_FALSE(
      exchanged(chain("rostopic: /cam0/image_raw", "\n  rostopic: /Event_cam/x", same), ""));
  // Without either, the order is kept with a warning.
  CHECK_FALSE(exchanged(chain("rostopic: /cam0/x", "\n  rostopic: /cam1/x", same),
                        "rostopic: /events into it"));
}
