// SPDX-License-Identifier: Apache-2.0
#include "jade/data/origin.h"

#include "support/catch.h"

#include <cmath>
#include <filesystem>
#include <torch/types.h>

#include "data/tiny_recording.h"
#include "jade/core/atomic_file.h"
#include "jade/imaging/image_io.h"
#include "jade/io/npy.h"
#include "support/colmap_writer.h"
#include "support/temp_dir.h"

namespace jade::data {
namespace {

namespace fs = std::filesystem;
using geometry::Vector3;

const Vector3 kUtm{471234.5, 5431987.25, 312};

geometry::Pose far_pose(double t_us, const Vector3& offset = kUtm) {
  return geometry::with_origin(test::steady_pose(t_us), {-offset[0], -offset[1], -offset[2]});
}

/// Checks that poses are equal after both data sets' origins are added.
void check_near(const Dataset& data, const Dataset& near_data, const Vector3& offset) {
  REQUIRE(data.train.size() == near_data.train.size());
  CHECK_FALSE(geometry::is_zero(data.origin));
  CHECK(geometry::is_zero(near_data.origin));
  CHECK(data.notes.size() == 1);
  CHECK(near_data.notes.empty());
  for (size_t i = 0; i < data.train.size(); ++i) {
    for (size_t k = 0; k < 9; ++k) {
      const Vector3 a = geometry::centre(data.train[i].poses[k]);
      const Vector3 b = geometry::centre(near_data.train[i].poses[k]);
      for (size_t axis = 0; axis < 3; ++axis) {
        CHECK(std::abs(a[axis]) < 10);
        CHECK(a[axis] + data.origin[axis] - offset[axis] == Approx(b[axis]).margin(1e-6));
      }
    }
  }
  CHECK(data.near == Approx(near_data.near).epsilon(1e-3));
}

void write_room(const fs::path& room, const Vector3& offset) {
  std::vector<io::ColmapImage> images;
  for (int i = 0; i < 6; ++i) {
    const geometry::Pose pose = far_pose(1e5 * i, offset);
    const std::string name = concat("img_0", i, ".png");
    images.push_back(
        {i + 1, geometry::quaternion_from_rotation(pose.rotation), pose.translation, 1, name});
    imaging::write_image(room / "images" / name, test::noise_image(i));
  }
  std::vector<double> points;
  for (int i = 0; i < 20; ++i) {
    for (const double value :
         {offset[0] + 0.1 * i, offset[1] - 0.05 * i, offset[2] + 4 + 0.1 * i}) {
      points.push_back(value);
    }
  }
  const io::ColmapCamera camera{1, "PINHOLE", test::kWidth, test::kHeight, {25, 25, 10.5, 6.5}};
  test::save_model(room / "sparse/0", test::text_model(camera, images, points));
}

Dataset load(const fs::path& folder) {
  DatasetOptions options;
  options.path = folder;
  std::vector<std::string> warnings;
  return load_dataset(options, &warnings);
}

TEST_CASE("origin: a COLMAP model in map coordinates is moved in double", "[data]") {
  const test::TempDir folder;
  write_room(folder / "far", kUtm);
  write_room(folder / "near", {0, 0, 0});
  const Dataset far = load(folder / "far"), near = load(folder / "near");
  check_near(far, near, kUtm);
  const torch::Tensor shift =
      torch::tensor({far.origin[0] - kUtm[0], far.origin[1] - kUtm[1], far.origin[2] - kUtm[2]});
  CHECK((far.points + shift - near.points).abs().max().item<float>() < 1e-5);
  CHECK(far.far == Approx(near.far).epsilon(1e-4));
}

TEST_CASE("origin: transforms.json and the EvDeblur layout are moved alike", "[data]") {
  const test::TempDir folder;
  for (const bool far : {false, true}) {
    const fs::path room = folder / (far ? "far" : "near");
    std::string frames;
    for (int i = 0; i < 3; ++i) {
      imaging::write_image(room / concat("f", i, ".png"), test::noise_image(i));
      const geometry::Pose pose =
          geometry::inverse(far_pose(1e5 * i, far ? kUtm : Vector3{0, 0, 0}));
      std::ostringstream text;
      text.precision(17);
      text << (i == 0 ? "" : ",") << "{\"file_path\":\"f" << i << ".png\",\"transform_matrix\":[";
      for (size_t row = 0; row < 3; ++row) {
        const double* r = pose.rotation.data() + 3 * row;
        text << "[" << r[0] << "," << -r[1] << "," << -r[2] << "," << pose.translation[row] << "],";
      }
      frames += text.str() + "[0,0,0,1]]}";
    }
    write_file(room / "transforms.json",
               "{\"fl_x\":25,\"ply_file_path\":\"p.ply\",\"frames\":[" + frames + "]}");
    // Points relative to the offset.
    write_file(room / "p.ply",
               concat("ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double "
                      "y\nproperty double z\nproperty uchar red\nproperty uchar green\nproperty "
                      "uchar blue\nend_header\n",
                      far ? "471234 5431987 316 1 2 3\n471235 5431988 318 4 5 6\n471234.5 "
                            "5431987.25 317 7 8 9\n"
                          : "-0.5 -0.25 4 1 2 3\n0.5 0.75 6 4 5 6\n0 0 5 7 8 9\n"));
  }
  const Dataset far_json = load(folder / "far"), near_json = load(folder / "near");
  check_near(far_json, near_json, kUtm);
  const Vector3& o = far_json.origin;
  REQUIRE(far_json.points.size(0) == 3);
  const torch::Tensor shift =
      torch::tensor({o[0] - kUtm[0], o[1] - kUtm[1], o[2] - kUtm[2]}, torch::kFloat64);
  CHECK((far_json.points + shift - near_json.points).abs().max().item<double>() < 1e-5);

  EvDeblurContent content = test::tiny_content();
  write_evdeblur(folder / "near_ev", content);
  const Dataset near = load(folder / "near_ev");
  const auto move = [](geometry::Pose& pose) {
    pose = geometry::with_origin(pose, {-kUtm[0], -kUtm[1], -kUtm[2]});
  };
  for (Exposure& exposure : content.train) {
    for (geometry::Pose& pose : exposure.poses) move(pose);
  }
  for (SharpView& view : content.test) move(view.pose);
  for (geometry::Pose& pose : content.path) move(pose);
  write_evdeblur(folder / "far_ev", content);
  const Dataset far = load(folder / "far_ev");
  check_near(far, near, kUtm);
  CHECK(far.trajectory.size() == near.trajectory.size());
}

TEST_CASE("origin: a data set moved to another origin is the same data set", "[data]") {
  const test::TempDir folder;
  write_room(folder / "room", kUtm);
  Dataset data = load(folder / "room");
  const Dataset before = data;
  move_origin(data, {kUtm[0] - 5, kUtm[1], kUtm[2]});
  CHECK(data.origin[0] == kUtm[0] - 5);
  const double shift = before.origin[0] - data.origin[0];
  CHECK(geometry::centre(data.train[0].poses[0])[0] ==
        Approx(geometry::centre(before.train[0].poses[0])[0] + shift));
  CHECK(data.points[3][0].item<float>() == Approx(before.points[3][0].item<float>() + shift));
}

TEST_CASE("origin: training's unit is 1 near depths of 1, else the depth", "[data]") {
  const auto unit = [](double near, double far) {
    data::Dataset data;
    data.near = near, data.far = far;
    return data::length_unit(data);
  };
  CHECK(unit(0.1, 0.4) == 1);
  CHECK(unit(4, 16) == 1);
  CHECK(unit(500, 2000) == Approx(1000));
  CHECK(unit(1e-3, 4e-3) == Approx(2e-3));
}

TEST_CASE("origin: cameras at one place are reported", "[data]") {
  Dataset data;
  data.near = 1;
  data.train.resize(3);
  const auto told = [&] {
    std::vector<std::string> lines;
    tell_still_cameras(data, Warnings(&lines));
    return lines.empty() ? "" : lines[0];
  };
  CHECK(told().find("one and the same pose") != std::string::npos);
  data.train[1].poses.fill({geometry::rotation_from_vector({0, 0.2, 0}), {0, 0, 0}});
  CHECK(told().find("one place") != std::string::npos);
  data.train[2].poses.fill({data.train[2].poses[0].rotation, {0.01, 0, 0}});
  CHECK(told().empty());
}

TEST_CASE("origin: equal poses near the origin of their coordinates are not moved", "[data]") {
  const std::vector<geometry::Pose> poses(
      24, geometry::pose_at_centre(geometry::rotation_from_vector({0.3, 0.4, 0.1}), {0.9, 0, 3}));
  CHECK(geometry::is_zero(origin_of(poses, {})));
}

}  // namespace
}  // namespace jade::data
