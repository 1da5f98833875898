// SPDX-License-Identifier: Apache-2.0
// jade_import from the command line: a recording without poses becomes a trainable scene, and bad
// input.
#include "support/catch.h"

#include <filesystem>
#include <nlohmann/json.hpp>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/data/dataset.h"
#include "jade/imaging/image_io.h"
#include "jade/import/colmap.h"
#include "jade/recording/python.h"
#include "support/naming.h"
#include "support/programs.h"
#include "support/temp_dir.h"
#include "support/tiny_dataset.h"

using namespace jade;
using test::check_error;
using test::Outcome;
using test::run;

namespace {

namespace fs = std::filesystem;

/// A data set without its poses is a recording.
void forget_poses(const fs::path& folder) {
  for (const char* file : {"poses_bounds.npy", "all_poses_bounds.npy", "all_timestamps.npy"}) {
    fs::remove(folder / file);
  }
}

bool has_colmap() {
  try {
    import::find_colmap({});
    return true;
  } catch (const DataError&) {
    return false;
  }
}

/// A second of a small desk, small enough for a test.
constexpr char kSimulate[] =
    "jade_simulate --quiet --recording --seed 7 --output desk --set simulate.world=desk "
    "--set simulate.width=200 --set simulate.height=150 --set simulate.focal_px=240 "
    "--set simulate.exposures=4 --set simulate.exposure_ms=40 --set simulate.gap_ms=40 "
    "--set simulate.test_views=1 --set simulate.seen_test_views=0 "
    "--set simulate.motion.blur_px=6 --set simulate.sampling.max_flow_px=3 "
    "--set simulate.sampling.samples=1 --set simulate.sampling.sharp_samples=1";

}  // namespace

TEST_CASE("jade_import: a simulated recording becomes a scene that trains", "[apps][slow]") {
  const test::TempDir dir;
  if (!has_colmap()) {
    WARN("SKIPPED: COLMAP is not installed; scripts/setup.sh --import installs it");
    SUCCEED();
    return;
  }
  const Outcome simulated = run(dir, kSimulate);
  INFO(simulated.err);
  REQUIRE(simulated.code == 0);
  const std::string import = "jade_import desk --output table";
  const Outcome imported = run(dir, import);
  INFO(imported.err);
  REQUIRE(imported.code == 0);
  CHECK_THAT(imported.out, Catch::Contains("jade_train --config table/scene.yaml"));
  data::DatasetOptions options;
  options.path = dir / "table";
  const data::Dataset data = data::load_dataset(options);
  CHECK(data.train.size() == 4);
  CHECK(data.test.size() == 1);
  CHECK(data.points.size(0) > 50);
  const Outcome compared = run(dir, recording::interpreter({}) + " " + JADE_SOURCE +
                                        "/scripts/compare_poses.py --json table desk/truth");
  INFO(compared.out << compared.err);
  REQUIRE(compared.code == 0);
  const auto errors = nlohmann::json::parse(compared.out);
  // 0.6 to 1.6 px in ten imports; poses that are static within an exposure are off by 3 px, half
  // its blur of 6 px, at its ends.
  for (const char* at : {"start_px", "middle_px", "end_px", "nine_px"}) CHECK(errors[at] < 2);
  CHECK_THAT(run(dir, import).err, test::naming("up to date", "--from"));
  const Outcome trained =
      run(dir,
          "jade_train --quiet --device cpu --config table/scene.yaml --output run "
          "--set train.iterations=20 --set objective.target=edi");
  INFO(trained.err);
  CHECK(trained.code == 0);
  CHECK(fs::exists(dir / "run/point_cloud.ply"));
}

TEST_CASE("jade_import: bad input is one line each", "[apps]") {
  const test::TempDir dir;
  test::write_tiny_dataset(dir / "three");
  forget_poses(dir / "three");
  const auto import = [&](const std::string& flags) {
    return run(dir,
               "touch colmap; chmod +x colmap; jade_import --quiet --output out "
               "--set poses.colmap=colmap " +
                   flags);
  };
  check_error(import("nowhere"), 3, "nowhere");
  check_error(import(""), 2, "recording");
  check_error(run(dir, "jade_import --quiet three"), 2, "--output");
  check_error(run(dir, "jade_import --quiet three --output out --set poses.colmap=gone"), 3, "gone",
              "colmap");
  for (const char* names : {"nothing", "'[nothing]'"}) {
    check_error(import(concat("three --from read --until read --test ", names)), 2, "--test");
  }
  check_error(run(dir, "jade_import --quiet three --output three"), 2, "--output");
  check_error(run(dir, "jade_import --quiet three --output three/out"), 2, "--output");
  fs::create_directories(dir / "mine");
  write_file(dir / "mine/notes.txt", "");
  check_error(run(dir, "jade_import --quiet three --output mine"), 2, "--output");
  // COLMAP is checked only if it is needed.
  CHECK(run(dir, "jade_import --quiet three --output early --until read --set poses.colmap=gone")
            .code == 0);
  check_error(import("three --from nothing"), 2, "--from", "read");
  check_error(import("three --begin-s 2 --end-s 1"), 2, "time.end_s");
  check_error(import("three --stamp begin"), 2, "time.stamp");
  check_error(
      run(dir,
          "jade_import --quiet three --output out --set poses.colmap=colmap --offset-ms 500000"),
      3, "overlap");
  write_file(dir / "notes.log", "0.1 3 4 1\n");
  check_error(import("notes.log"), 3, "'notes.log'", ".txt");
  fs::remove(dir / "three/events.h5");
  check_error(import("three"), 3, "three", "events");
  fs::remove_all(dir / "three/images_1");
  test::write_tiny_dataset(dir / "more");
  fs::copy(dir / "more/events.h5", dir / "three/events.h5");
  check_error(import("three"), 3, "three", "frames");
}

TEST_CASE("jade_import: --quiet hides notes, not warnings of wrong input", "[apps]") {
  const test::TempDir dir;
  std::string events;
  for (int i = 0; i < 400; ++i)
    events += concat(1e-4 * i, " ", i % 32, " ", i % 24, " ", i % 2, "\n");
  dir.write("rpg/events.txt", events);
  dir.write("rpg/poses.txt", "");
  std::string list = "0.039 images/lost.png\n";
  for (const int k : {1, 2, 3, 4}) {
    list += concat(0.008 * k, " images/", k, ".png\n");
    imaging::write_image(dir / concat("rpg/images/", k, ".png"), torch::rand({3, 24, 32}));
  }
  dir.write("rpg/images.txt", list);
  const Outcome quiet =
      run(dir, "jade_import rpg --quiet --exposure-ms 5 --until read --output out");
  INFO(quiet.err);
  CHECK(quiet.code == 0);
  CHECK_THAT(quiet.err, Catch::Contains("warning: ") && test::naming("images.txt", "lost.png"));
  CHECK_THAT(quiet.err, !Catch::Contains("poses.txt"));
}
