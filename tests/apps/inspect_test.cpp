// SPDX-License-Identifier: Apache-2.0
// jade_inspect on data sets, runs and Gaussians.
#include "support/catch.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <sys/stat.h>
#include <torch/types.h>

#include "jade/data/dataset.h"
#include "jade/data/evdeblur_writer.h"
#include "jade/gaussians/ply.h"
#include "jade/imaging/image_io.h"
#include "jade/io/npy.h"
#include "support/naming.h"
#include "support/programs.h"
#include "support/temp_dir.h"
#include "support/tiny_dataset.h"

using namespace jade;
using test::check_error;
using test::Outcome;
using test::run;

namespace {

splat::Gaussians some_gaussians() {
  splat::Gaussians g;
  g.means = torch::rand({50, 3});
  g.rotations = torch::tensor({1.F, 0.F, 0.F, 0.F}).repeat({50, 1});
  g.log_scales = torch::full({50, 3}, -3.F);
  g.logit_opacities = torch::full({50}, 1.F);
  g.sh = torch::zeros({50, 4, 3});
  return g;
}

}  // namespace

TEST_CASE("jade_inspect: Gaussians are counted, measured, and their problems named", "[apps]") {
  const test::TempDir dir;
  splat::Gaussians g = some_gaussians();
  gaussians::write_ply(dir / "good.ply", {g, false});
  const Outcome good = run(dir, "jade_inspect good.ply");
  CHECK(good.code == 0);
  CHECK_THAT(good.out, Catch::Contains("50, SH degree 1"));
  CHECK_THAT(good.out, Catch::Contains("No problems found"));
  g.means[3][1] = std::nanf("");
  g.rotations[7].zero_();
  g.logit_opacities.slice(0, 10, 45).fill_(-9);
  gaussians::write_ply(dir / "bad.ply", {g, false});
  const Outcome bad = run(dir, "jade_inspect bad.ply");
  CHECK(bad.code == 0);
  for (const char* text : {"1 of 50 Gaussians have NaN or Inf in their means",
                           "1 of 50 Gaussians have the zero quaternion", "next to transparent"}) {
    CHECK_THAT(bad.out, Catch::Contains(text));
  }
  CHECK_THAT(run(dir, "jade_inspect bad.ply --json").out, Catch::Contains("\"gaussians\": 50"));
  dir.write("text.ply", "hello");
  check_error(run(dir, "jade_inspect text.ply"), 3, "text.ply");
  check_error(run(dir, "jade_inspect nowhere.ply"), 3, "nowhere.ply");
}

TEST_CASE("jade_inspect: a run says how far it came and what is wrong with it", "[apps]") {
  const test::TempDir dir;
  test::write_tiny_dataset(dir / "scene");
  const Outcome trained =
      run(dir,
          "jade_train --quiet --device cpu --set dataset.path=scene --set objective.target=edi "
          "--set init.points=200 --set train.iterations=4 --output run");
  INFO(trained.err);
  REQUIRE(trained.code == 0);
  const Outcome whole = run(dir, "jade_inspect run");
  INFO(whole.err);
  CHECK(whole.code == 0);
  CHECK_THAT(whole.out, Catch::Contains("step 4 of 4"));
  run(dir, "sed -i 's/iterations: 4/iterations: 6/' run/config.yaml");
  CHECK_THAT(
      run(dir, concat(JADE_BIN, "/jade_inspect run")).out,
      Catch::Contains(concat("stopped at step 4 of 6: go on with ", JADE_BIN,
                             "/jade_train --output ", (dir / "run").string(), " --resume\n")));
  dir.write("run/checkpoints/step_0000009.pt", "cut short");
  std::filesystem::rename(dir / "scene", dir / "moved");
  const Outcome damaged = run(dir, "jade_inspect run");
  CHECK(damaged.code == 0);
  CHECK_THAT(damaged.out, test::naming("step_0000009.pt"));
  CHECK_THAT(damaged.out, Catch::Contains("is gone"));
}

TEST_CASE("jade_inspect: says whether the frames are monochrome", "[apps]") {
  const test::TempDir dir;
  test::write_tiny_dataset(dir / "coloured");
  test::write_tiny_dataset(dir / "gray", {36, 28, 3, false, true});
  CHECK_THAT(run(dir, "jade_inspect gray").out, Catch::Contains("monochrome"));
  CHECK_THAT(run(dir, "jade_inspect coloured").out, test::naming("colour"));
  CHECK_THAT(run(dir, "jade_inspect gray --json").out, Catch::Contains("\"color\": \"gray\""));
  CHECK_THAT(run(dir, "jade_inspect coloured --json").out, Catch::Contains("\"color\": \"color\""));
}

TEST_CASE("jade_inspect: names all image sizes", "[apps]") {
  const test::TempDir dir;
  const std::string pose = R"("transform_matrix":[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]])";
  dir.write("scene/transforms.json", R"({"fl_x":40,"frames":[{"file_path":"a.png","w":40,"h":30,)" +
                                         pose + R"(},{"file_path":"b.png","w":20,"h":36,)" + pose +
                                         "}]}");
  imaging::write_image(dir / "scene/a.png", torch::rand({3, 30, 40}));
  imaging::write_image(dir / "scene/b.png", torch::rand({3, 36, 20}));
  const Outcome outcome = run(dir, "jade_inspect scene --split none");
  INFO(outcome.err);
  CHECK_THAT(outcome.out, test::naming("40x30", "20x36"));
}

TEST_CASE("jade_inspect: events by another clock than the frames' are a problem", "[apps]") {
  const test::TempDir dir;
  const Outcome made =
      run(dir,
          "jade_simulate --quiet --set simulate.width=120 --set simulate.height=90 --set "
          "simulate.focal_px=120 --set simulate.exposures=5 --set simulate.test_views=2 --set "
          "simulate.sampling.samples=1 --output scene");
  INFO(made.err);
  REQUIRE(made.code == 0);
  const auto problem = [&] { return run(dir, "jade_inspect scene").out; };
  CHECK_THAT(problem(), Catch::Contains("No problems found"));
  data::DatasetOptions options;
  options.path = dir / "scene";
  const events::EventStream events = data::load_dataset(options).events;
  for (const auto& [shift_us, said] :
       {std::pair{20000, "ms later than the changes"}, {-20000, "ms earlier than the changes"}}) {
    data::write_event_file(dir / "scene" / "events.h5",
                           {events.x(), events.y(), events.t_us() + shift_us, events.polarity()});
    CHECK_THAT(problem(), Catch::Contains(said));
    CHECK_THAT(problem(), Catch::Contains("the clocks differ"));
  }
}

TEST_CASE("jade_inspect: what is none of the three gets one line", "[apps]") {
  const test::TempDir dir;
  std::filesystem::create_directories(dir / "empty");
  check_error(run(dir, "jade_inspect empty"), 3, "poses_bounds.npy", "transforms.json");
  check_error(run(dir, "jade_inspect nowhere"), 3, "nowhere");
  REQUIRE(mkfifo((dir / "pipe").c_str(), 0600) == 0);
  check_error(run(dir, "jade_inspect pipe"), 3, "pipe", "expected a file or a folder");
  check_error(run(dir, "jade_import pipe --until read --output out --quiet"), 3, "pipe",
              "found a pipe or a device");
  dir.write("model/sparse/0/cameras.txt", "1 PINHOLE 8 6 5 5 4 3\n");
  dir.write("model/sparse/0/images.txt", "1 1 0 0 0 0 0 0 1 a.png\n\n");
  dir.write("model/sparse/0/points3D.txt", "1 2 soon\n");
  check_error(run(dir, "jade_inspect model"), 3, "points3D.txt: line 1", "POINT3D_ID");
  check_error(run(dir, "jade_inspect"), 2, "--help");
  test::write_tiny_dataset(dir / "scene");
  CHECK_THAT(run(dir, "jade_inspect scene").out, Catch::Contains("No problems found"));
}

TEST_CASE("jade_inspect: the next command has the keys of the data set that were given", "[apps]") {
  const test::TempDir dir;
  test::write_tiny_dataset(dir / "scene");
  const Outcome plain = run(dir, "jade_inspect scene");
  CHECK_THAT(plain.out, !Catch::Contains("--set"));
  const Outcome given = run(dir, "jade_inspect scene --image-folder images_1");
  CHECK_THAT(given.out, test::naming("--set dataset.image_folder=images_1", "--output runs/"));
}

TEST_CASE("jade_inspect: test views are marked by whether training sees them", "[apps]") {
  const test::TempDir dir;
  test::write_tiny_dataset(dir / "scene");
  data::DatasetOptions options;
  options.path = dir / "scene";
  const data::Dataset dataset = data::load_dataset(options);
  std::vector<int64_t> start, end;
  for (const data::Exposure& exposure : dataset.train) {
    start.push_back(exposure.t_start_us), end.push_back(exposure.t_end_us);
  }
  for (const int64_t t_us : {dataset.train[1].t_end_us, dataset.test[1].t_us}) {
    start.push_back(t_us), end.push_back(t_us);
  }
  io::write_npz(dir / "scene/images_1/timestamps.npz",
                {{"timestamps_start", torch::tensor(start, torch::kInt64)},
                 {"timestamps_end", torch::tensor(end, torch::kInt64)}});
  CHECK_THAT(run(dir, "jade_inspect scene").out, Catch::Contains("03 (seen), 04 (unseen)\n"));
  const auto json = nlohmann::json::parse(run(dir, "jade_inspect scene --json").out);
  CHECK(json["test"] == nlohmann::json{"03", "04"});
  CHECK(json["test_seen"] == nlohmann::json{true, false});
}

TEST_CASE("jade_inspect: a recording, what is missing, and the next command", "[apps]") {
  const test::TempDir dir;
  dir.write("scene/events.txt", "0.1 7 5 1\n0.3 0 0 0\n0.5 1 1 1\n");
  dir.write("scene/images.txt", "0.2 images/a.png\n0.4 images/b.png\n");
  for (const char* name : {"a", "b"})
    imaging::write_image(dir / "scene/images" / (std::string(name) + ".png"),
                         torch::full({3, 6, 8}, 0.5));
  const Outcome bare = run(dir, "jade_inspect scene");
  INFO(bare.err);
  CHECK(bare.code == 0);
  for (const char* text :
       {"folder of frames and events", "sensor      8x6 px",
        "events      3 from 0.100000 to 0.500000 s", "66.7 % positive",
        "frames      2 of 8x6 px, 5 a second", "of unknown length", "next        jade_import ",
        "/scene --calibration CAMERA.yaml --output data/scene"}) {
    CHECK_THAT(bare.out, Catch::Contains(text));
  }
  dir.write("scene/exposures.csv", "a,190000,210000\nb,390000,420000\n");
  dir.write("scene/calib.txt", "6 6 4 3 0 0 0 0 0\n");
  const Outcome whole = run(dir, "jade_inspect scene");
  CHECK_THAT(whole.out, test::naming("exposures", "20 to 30 ms", "median 30"));
  CHECK_THAT(whole.out, Catch::Contains("/scene --output data/scene"));
  run(dir, "cp -r scene other");
  dir.write("other/calib.txt", "6 6 30 30 0 0 0 0 0\n");
  CHECK_THAT(run(dir, "jade_inspect other").out,
             test::naming("warning", "other/calib.txt", "principal point", "8x6"));
  // The event camera of a rig may be smaller than the frames, if nothing says its size.
  dir.write("other/camchain.yaml",
            "cam0:\n  camera_model: pinhole\n  intrinsics: [6, 6, 4, 3]\n  resolution: [8, 6]\n"
            "  distortion_model: none\n  distortion_coeffs: []\n"
            "cam1:\n  camera_model: pinhole\n  intrinsics: [6, 6, 3.5, 3]\n  resolution: [7, 6]\n"
            "  distortion_model: none\n  distortion_coeffs: []\n"
            "  T_cn_cnm1: [[1, 0, 0, 0.1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n");
  CHECK_THAT(run(dir, "jade_inspect other").out,
             test::naming("calibration camchain.yaml") && !Catch::Contains("calibrated at"));
  const auto json = nlohmann::json::parse(run(dir, "jade_inspect scene --json").out);
  CHECK(json["events"] == 3);
  CHECK(json["frames"][1]["t_end_us"] == 420000);
  CHECK_THAT(run(dir, "jade_inspect scene/").out,
             test::naming("--output data/scene\n", "expected at least 4 frames", "found 2"));
  run(dir, "mkdir data && cp -r scene data/scene");
  CHECK_THAT(run(dir, "jade_inspect data/scene").out, Catch::Contains("--output data/scene-out\n"));
  run(dir, "mkdir odd && cp -r scene odd/s");
  run(dir, "cd odd/s/images && mv a.png \"$(printf 'a\\337')\".png");
  run(dir,
      "cd odd/s && rm images.txt && printf 'a\\337,190000,210000\nb,390000,420000\n' > "
      "exposures.csv");
  CHECK_THAT(run(dir, "jade_inspect odd/s --json").out, Catch::Contains("a\xEF\xBF\xBD"));
  const Outcome alone = run(dir, "jade_inspect scene/events.txt");
  CHECK_THAT(alone.out, Catch::Contains("--frames FOLDER_OR_VIDEO --frame-times LIST.csv"));
  run(dir, "rm scene/exposures.csv scene/images.txt");
  const Outcome untimed = run(dir, "jade_inspect scene");
  CHECK_THAT(untimed.out, test::naming("2 of 2 frames", "time"));
  CHECK_THAT(untimed.out, Catch::Contains("/scene --frame-times LIST.csv --output data/scene"));
  check_error(run(dir, "jade_import --quiet scene --output out --until read"), 3, "2 frames",
              "--frame-times");
  check_error(run(dir, "jade_inspect scene/images/a.png"), 3, "scene/images/a.png");
  dir.write("empty.raw", "");
  check_error(run(dir, "jade_inspect empty.raw"), 3, "empty.raw", "is empty");
}
