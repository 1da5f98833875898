// SPDX-License-Identifier: Apache-2.0
#include "jade/recording/rpg_writer.h"

#include "support/catch.h"

#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "support/temp_dir.h"

using namespace jade;
using namespace jade::recording;

TEST_CASE("rpg_writer: what is written is read back equal", "[recording]") {
  const test::TempDir dir;
  Recording written;
  written.events =
      events::EventStream::from_lists({0, 15, 3.25F, 1}, {11, 0, 2.125F, 1},
                                      {-1500, 0, 1234567890123, 1234567890124}, {1, -1, 1, -1});
  // Steps of 8 bits, so that nothing is rounded.
  const auto image = torch::arange(3 * 12 * 16).reshape({3, 12, 16}).remainder(256) / 255.;
  written.frames = {{"00", image.to(torch::kFloat32), 100, 301},
                    {"12", image.flip(2).to(torch::kFloat32).contiguous(), 400, 400}};
  const geometry::Intrinsics camera = geometry::Intrinsics::centred(20.125, 16, 12);
  write_rpg(dir / "a", written, camera);
  const Recording read = read_recording(dir / "a");
  CHECK(read.width == 16);
  CHECK(read.height == 12);
  CHECK(read.events.x().equal(written.events.x()));
  CHECK(read.events.y().equal(written.events.y()));
  CHECK(read.events.t_us().equal(written.events.t_us()));
  CHECK(read.events.polarity().equal(written.events.polarity()));
  REQUIRE(read.frames.size() == 2);
  for (size_t i = 0; i < 2; ++i) {
    CHECK(read.frames[i].name == written.frames[i].name);
    CHECK((read.frames[i].image - written.frames[i].image).abs().max().item<float>() < 1e-6F);
    CHECK(read.frames[i].t_start_us == written.frames[i].t_start_us);
    CHECK(read.frames[i].t_end_us == written.frames[i].t_end_us);
  }
  CHECK(read_file(dir / "a/images.txt") == "0.000200 images/00.png\n0.000400 images/12.png\n");
  CHECK(read_file(dir / "a/calib.txt") == "20.125 20.125 7.5 5.5 0 0 0 0 0\n");
  REQUIRE(!read.calibrations.empty());
  CHECK(read.calibrations.front().name == "calibration.yaml");
  CHECK_THAT(read.calibrations.front().text, Catch::StartsWith("%YAML:1.0\n"));
  CHECK_THAT(read.calibrations.front().text,
             Catch::Contains("data: [ 20.125, 0., 7.5, 0., 20.125, 5.5, 0., 0., 1. ]"));
}

TEST_CASE("rpg_writer: two cameras are written as Kalibr does, and found", "[recording]") {
  const test::TempDir dir;
  Recording written;
  written.events = events::EventStream::from_lists({1, 2}, {1, 2}, {0, 10}, {1, -1});
  write_rpg(dir.path(), written);
  write_camchain(dir.path(), {geometry::Intrinsics::centred(20.5, 16, 12),
                              geometry::Intrinsics::centred(30, 24, 18),
                              {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {-0.125, 0.5, 0.25}}});
  const Recording read = read_recording(dir.path());
  REQUIRE(!read.calibrations.empty());
  CHECK(read.calibrations.front().name == "camchain.yaml");
  CHECK_FALSE(read.size_is_said);
  for (const char* line :
       {"cam0:\n  camera_model: pinhole\n", "cam1:\n  T_cn_cnm1:\n", "  - [1., 0., 0., -0.125]\n",
        "intrinsics: [20.5, 20.5, 7.5, 5.5]", "resolution: [24, 18]", "rostopic: /events"}) {
    CHECK_THAT(read.calibrations.front().text, Catch::Contains(line));
  }
}
