// SPDX-License-Identifier: Apache-2.0
// All programs that read a data set accept the keys of jade_train.
#include "support/catch.h"

#include "jade/core/atomic_file.h"
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

const char* const kPrograms[] = {"jade_inspect", "jade_deblur", "jade_render", "jade_eval"};

/// The value of a key's last part in a printed configuration.
std::string printed(const test::TempDir& dir, const std::string& command, const std::string& name) {
  const Outcome outcome = run(dir, command + " --print-config");
  INFO(command << ": " << outcome.err);
  CHECK(outcome.code == 0);
  const std::string start = "  " + name + ": ";
  const size_t at = outcome.out.find(start);
  REQUIRE(at != std::string::npos);
  const size_t begin = at + start.size();
  return outcome.out.substr(begin, outcome.out.find("  #", begin) - begin);
}

}  // namespace

TEST_CASE("settings: run, files, --set and flags are laid over each other in this order",
          "[apps]") {
  const test::TempDir dir;
  fs::create_directories(dir / "run");
  dir.write("run/config.yaml", "device: cuda:3\ndataset: {split: last, test_last: 1}\n");
  dir.write("a.yaml", "dataset: {test_last: 2, split: every}\n");
  dir.write("b.yaml", "dataset: {test_last: 3}\n");
  for (const std::string program : {"jade_deblur", "jade_render", "jade_eval"}) {
    const std::string start = program + " --run run";
    CHECK(printed(dir, start, "test_last") == "1");
    CHECK(printed(dir, start + " --config a.yaml", "test_last") == "2");
    CHECK(printed(dir, start + " --config a.yaml --config b.yaml", "test_last") == "3");
    CHECK(printed(dir, start + " --config a.yaml --config b.yaml", "split") == "every");
    // Their position on the command line does not matter.
    const std::string set = program + " --set dataset.test_last=4 --config a.yaml --run run";
    CHECK(printed(dir, set, "test_last") == "4");
    CHECK(printed(dir, program + " --split none --set dataset.split=auto --run run", "split") ==
          "none");
    // The run's device may not exist on this machine.
    CHECK_THAT(run(dir, start + " --print-config").out, Catch::Contains("\ndevice: auto "));
    CHECK_THAT(run(dir, start + " --device cpu --print-config").out,
               Catch::Contains("\ndevice: cpu "));
  }
  CHECK(printed(dir, "jade_inspect --config a.yaml --config b.yaml --split last", "split") ==
        "last");
}

TEST_CASE("settings: a mistake reads the same in each program", "[apps]") {
  const test::TempDir dir;
  dir.write("bad.yaml", "exposure:\n  sampels: 9\n");
  for (const std::string program : kPrograms) {
    INFO(program);
    check_error(run(dir, program + " --config bad.yaml"), 2, "bad.yaml:2:3", "exposure.sampels",
                "exposure.samples?");
    check_error(run(dir, program + " --set exposure.samples=many"), 2,
                "--set exposure.samples=many", "5 to 65");
    check_error(run(dir, program + " --set exposure.samples=6"), 2, "exposure.samples", "odd");
    check_error(run(dir, program + " --set events.bins=8"), 2, "events.bins", "CHANGELOG.md");
    check_error(run(dir, program + " --kind foo"), 2, "--kind foo: dataset.kind", "auto, evdeblur");
    CHECK_THAT(run(dir, program + " --help").out, Catch::Contains("Settings, later wins:"));
  }
}

TEST_CASE("settings: an old key works and is named once", "[apps]") {
  const test::TempDir dir;
  dir.write("old.yaml", "scene: {target: edi}\ncrf: {enabled: false}\n");
  const Outcome old = run(dir, "jade_train --config old.yaml --print-config");
  CHECK(old.code == 0);
  CHECK(std::count(old.err.begin(), old.err.end(), '\n') == 2);
  CHECK_THAT(old.err, test::naming("old.yaml:1:1", "scene", "objective"));
  CHECK_THAT(old.err, test::naming("old.yaml:2:1", "crf", "response"));
  dir.write("new.yaml", "objective: {target: edi}\nresponse: {enabled: false}\n");
  const Outcome now = run(dir, "jade_train --config new.yaml --print-config");
  CHECK(now.err.empty());
  CHECK(now.out == old.out);
}

TEST_CASE("settings: a scene's file serves every program; paths start where they are named",
          "[apps]") {
  const test::TempDir dir;
  test::write_tiny_dataset(dir / "data/scene");
  fs::create_directories(dir / "configs");
  dir.write("configs/scene.yaml",
            "dataset: {path: ../data/scene}\nobjective: {target: edi}\ninit: {points: 100}\n"
            "poses: {optimize: none}\ntrain: {iterations: 3}\n");
  const std::string scene = " --config configs/scene.yaml ";
  const Outcome inspected = run(dir, "jade_inspect --json" + scene);
  INFO(inspected.err);
  CHECK(inspected.code == 0);
  CHECK_THAT(inspected.out, Catch::Contains("\"kind\": \"evdeblur\""));
  check_error(run(dir, "jade_inspect --split none" + scene), 3, "dataset.split none");
  const Outcome deblurred = run(dir, "jade_deblur --quiet --output out" + scene);
  INFO(deblurred.err);
  CHECK(deblurred.code == 0);
  CHECK(fs::exists(dir / "out/00.png"));
  REQUIRE(run(dir, "jade_train --quiet --device cpu --output run" + scene).code == 0);
  const std::string render = "jade_render --quiet --device cpu --format npy ";
  CHECK(run(dir, render + "--ply run/point_cloud.ply --output a" + scene).code == 0);
  CHECK(run(dir, render + "--run run --output b").code == 0);
  CHECK(read_file(dir / "a/03.npy") == read_file(dir / "b/03.npy"));
  const Outcome scored = run(dir, "jade_eval --device cpu --json --run run" + scene);
  INFO(scored.err);
  CHECK(scored.code == 0);
  CHECK(run(dir, "jade_eval --device cpu --json --run run").out == scored.out);

  // Other settings give other scores, which must not replace those of the run.
  const std::string scores = read_file(dir / "run/eval.json"),
                    other = "jade_eval --device cpu --run run ";
  write_file(dir / "mask.png", read_file(dir / "data/scene/images_1/00.png"));
  check_error(run(dir, other + "--mask mask.png"), 2, "--output", "dataset.mask", "mask.png");
  check_error(run(dir, other + "--output ./run --set exposure.samples=5"), 2, "--output",
              "exposure.samples");
  check_error(run(dir, other + "--dataset mask.png"), 2, "--output", "dataset.path");
  CHECK(read_file(dir / "run/eval.json") == scores);
  CHECK(run(dir, other + "--set exposure.samples=5 --output other").code == 0);
  CHECK(fs::exists(dir / "other/eval.json"));

  // A flag's value is used verbatim, relative to the working directory.
  fs::rename(dir / "data/scene", dir / "a: [b");
  CHECK(run(dir, "jade_deblur --quiet --output c --dataset 'a: [b'" + scene).code == 0);
  CHECK(run(dir, "jade_inspect 'a: [b'").code == 0);
  check_error(run(dir, "jade_inspect" + scene), 3, "data/scene");
  check_error(run(dir, "jade_render --output d --ply run/point_cloud.ply"), 2,
              "--run or --dataset");
}

TEST_CASE("settings: the thresholds of jade_deblur mean the same in each form", "[apps]") {
  const test::TempDir dir;
  test::write_tiny_dataset(dir / "scene");
  dir.write("events.yaml", "events: {threshold_positive: 0.1, threshold_negative: 0.4}\n");
  const std::string deblur = "jade_deblur --quiet --npy --dataset scene --output ";
  CHECK(run(dir, deblur + "a --config events.yaml").code == 0);
  CHECK(run(dir, deblur + "b --threshold-positive 0.1 --threshold-negative 0.4").code == 0);
  CHECK(run(dir, deblur + "c --no-cache").code == 0);
  CHECK(read_file(dir / "a/01.npy") == read_file(dir / "b/01.npy"));
  CHECK(read_file(dir / "a/01.npy") != read_file(dir / "c/01.npy"));
}

TEST_CASE("settings: a run's learned cameras stay, whatever is laid over its settings", "[apps]") {
  const test::TempDir dir;
  test::write_tiny_dataset(dir / "scene");
  const Outcome trained = run(
      dir,
      "jade_train --quiet --device cpu --set dataset.path=scene --set objective.target=none --set "
      "objective.warmup=2 --set init.points=200 --set train.iterations=10 --set "
      "poses.optimize=linear --set poses.test_fit_steps=5 --output run");
  INFO(trained.err);
  REQUIRE(trained.code == 0);
  dir.write("plain.yaml", "poses: {optimize: none}\n");
  const std::string score = "jade_eval --quiet --device cpu --json --run run ";
  const Outcome own = run(dir, score);
  CHECK(own.code == 0);
  CHECK(run(dir, score + "--config plain.yaml --set objective.blur=false").out == own.out);
  const std::string render = "jade_render --quiet --device cpu --format npy ";
  CHECK(run(dir, render + "--run run --output a").code == 0);
  CHECK(run(dir, render + "--run run --config plain.yaml --output b").code == 0);
  CHECK(run(dir, render + "--ply run/point_cloud.ply --dataset scene --output c").code == 0);
  CHECK(read_file(dir / "a/03.npy") == read_file(dir / "b/03.npy"));
  CHECK(read_file(dir / "a/03.npy") != read_file(dir / "c/03.npy"));
}

TEST_CASE("settings: what is odd about a data set is said by each program that reads it",
          "[apps]") {
  const test::TempDir dir;
  test::write_tiny_dataset(dir / "scene", {36, 28, 3, /*last_exposure_without_events=*/true});
  REQUIRE(run(dir,
              "jade_train --quiet --device cpu --output run --set dataset.path=scene --set "
              "objective.target=edi --set init.points=100 --set train.iterations=3")
              .code == 0);
  for (const std::string command :
       {"jade_deblur --quiet --dataset scene --output a",
        "jade_eval --quiet --device cpu --run run",
        "jade_render --quiet --device cpu --run run --output b",
        "jade_render --quiet --device cpu --ply run/point_cloud.ply --dataset scene --output c"}) {
    const Outcome outcome = run(dir, command);
    INFO(command << ": " << outcome.err);
    CHECK(outcome.code == 0);
    CHECK_THAT(outcome.err, Catch::Contains("warning: ") && test::naming("events"));
  }
}
