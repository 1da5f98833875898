// SPDX-License-Identifier: Apache-2.0
#include "jade/recording/rpg_writer.h"

#include <cinttypes>
#include <cstdio>
#include <fstream>
#include <string>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/imaging/image_io.h"

namespace jade::recording {
namespace {

namespace fs = std::filesystem;

/// Whole µs as decimal seconds, exact.
std::string seconds_text(int64_t t_us) {
  const int64_t size = t_us < 0 ? -t_us : t_us;
  char text[40];
  std::snprintf(text, sizeof text, "%s%" PRId64 ".%06" PRId64, t_us < 0 ? "-" : "", size / 1000000,
                size % 1000000);
  return text;
}

/// Writes one line per event, in blocks of a megabyte.
void write_events(const fs::path& path, const events::EventStream& events) {
  AtomicFile target(path);
  std::ofstream file(target.temporary_path(), std::ios::binary | std::ios::trunc);
  const float *x = events.x().const_data_ptr<float>(), *y = events.y().const_data_ptr<float>();
  const int64_t* t = events.t_us().const_data_ptr<int64_t>();
  const int8_t* p = events.polarity().const_data_ptr<int8_t>();
  std::string text;
  for (int64_t i = 0; i < events.size(); ++i) {
    char pixel[64];
    std::snprintf(pixel, sizeof pixel, " %.9g %.9g %d\n", double(x[i]), double(y[i]),
                  p[i] > 0 ? 1 : 0);
    text += seconds_text(t[i]) + pixel;
    if (text.size() < (size_t(1) << 20) && i + 1 < events.size()) continue;
    file.write(text.data(), std::streamsize(text.size()));
    text.clear();
  }
  file.close();
  if (!file) throw DataError(concat(path.string(), ": cannot be written; check the free space"));
  target.commit();
}

int64_t stamp_of(const Frame& frame, Stamp stamp) {
  const int64_t length = frame.t_end_us - frame.t_start_us;
  return frame.t_start_us + (stamp == Stamp::kStart    ? 0
                             : stamp == Stamp::kMiddle ? length / 2
                                                       : length);
}

void write_frames(const fs::path& folder, const Recording& recording, bool exposure_times) {
  std::string list;
  std::vector<NamedExposure> exposures;
  for (const Frame& frame : recording.frames) {
    const std::string name = concat("images/", frame.name, ".png");
    imaging::write_image(folder / name, frame.image);
    list += concat(seconds_text(stamp_of(frame, recording.stamp)), " ", name, "\n");
    exposures.push_back({frame.name, frame.t_start_us, frame.t_end_us});
  }
  write_file(folder / "images.txt", list);
  if (exposure_times) write_exposures(folder / "exposures.csv", exposures);
}

std::string opencv_matrix(const char* name, int rows, int columns, const std::string& data) {
  return concat(name, ": !!opencv-matrix\n   rows: ", rows, "\n   cols: ", columns,
                "\n   dt: d\n   data: [ ", data, " ]\n");
}

/// A real number in OpenCV's YAML must have a decimal point.
std::string number(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.17g", value);
  return std::string(text).find_first_of(".e") == std::string::npos ? std::string(text) + "."
                                                                    : std::string(text);
}

void write_calibration(const fs::path& folder, const geometry::Intrinsics& camera) {
  const std::string fx = number(camera.fx), fy = number(camera.fy), cx = number(camera.cx - 0.5),
                    cy = number(camera.cy - 0.5);
  write_file(folder / "calib.txt", concat(fx, " ", fy, " ", cx, " ", cy, " 0 0 0 0 0\n"));
  write_file(
      folder / "calibration.yaml",
      concat("%YAML:1.0\n---\nimage_width: ", camera.width, "\nimage_height: ", camera.height, "\n",
             opencv_matrix("camera_matrix", 3, 3,
                           concat(fx, ", 0., ", cx, ", 0., ", fy, ", ", cy, ", 0., 0., 1.")),
             opencv_matrix("distortion_coefficients", 1, 5, "0., 0., 0., 0., 0.")));
}

std::string kalibr_camera(const char* name, const std::string& pose, const geometry::Intrinsics& c,
                          const char* topic) {
  return concat(name, ":\n", pose,
                "  camera_model: pinhole\n  distortion_coeffs: [0.0, 0.0, 0.0, 0.0]\n"
                "  distortion_model: radtan\n  intrinsics: [",
                number(c.fx), ", ", number(c.fy), ", ", number(c.cx - 0.5), ", ",
                number(c.cy - 0.5), "]\n  resolution: [", c.width, ", ", c.height,
                "]\n  rostopic: ", topic, "\n");
}

std::string kalibr_pose(const geometry::Pose& pose) {
  std::string rows = "  T_cn_cnm1:\n";
  for (size_t i = 0; i < 3; ++i) {
    const double* r = &pose.rotation[3 * i];
    rows += concat("  - [", number(r[0]), ", ", number(r[1]), ", ", number(r[2]), ", ",
                   number(pose.translation[i]), "]\n");
  }
  return rows + "  - [0.0, 0.0, 0.0, 1.0]\n";
}

}  // namespace

void write_camchain(const fs::path& folder, const CameraPair& cameras) {
  make_writable_folder(folder);
  write_file(folder / "camchain.yaml",
             kalibr_camera("cam0", "", cameras.frames, "/frames") +
                 kalibr_camera("cam1", kalibr_pose(cameras.events_from_frames), cameras.events,
                               "/events"));
}

void write_rpg(const fs::path& folder, const Recording& recording,
               const std::optional<geometry::Intrinsics>& camera, bool exposure_times) {
  make_writable_folder(folder);
  write_events(folder / "events.txt", recording.events);
  if (!recording.frames.empty()) write_frames(folder, recording, exposure_times);
  if (camera) write_calibration(folder, *camera);
}

}  // namespace jade::recording
