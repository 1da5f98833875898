// SPDX-License-Identifier: Apache-2.0
// jade_sweep from the command line, with the real training program on a tiny data set.
#include "support/catch.h"

#include <cstdlib>
#include <sys/wait.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "support/naming.h"
#include "support/temp_dir.h"
#include "support/tiny_dataset.h"

using namespace jade;

namespace {

struct Outcome {
  int code;
  std::string out, err;
};

Outcome run(const test::TempDir& dir, const std::string& arguments) {
  const auto out = dir / "out.txt", err = dir / "err.txt";
  const int status =
      std::system((std::string("cd ") + dir.path().string() + " && " + JADE_BIN + "/jade_sweep " +
                   arguments + " >" + out.string() + " 2>" + err.string())
                      .c_str());
  return {WIFEXITED(status) ? WEXITSTATUS(status) : 128, read_file(out), read_file(err)};
}

/// Two rows, one scene, two seeds.
void write_sweep(const test::TempDir& dir) {
  test::write_tiny_dataset(dir / "scene");
  dir.write("tiny.yaml",
            "dataset: {path: scene}\ninit: {points: 200}\nscene: {target: edi}\ntrain: "
            "{iterations: 4}\n");
  dir.write(
      "bare.yaml",
      "objective: {blur: false, edi_supervision: false, simulation: false, intensity: false}\n");
  dir.write("sweep.yaml",
            "columns: [psnr, ssim, minutes, memory_gib]\nseeds: [0, 1]\n"
            "scenes: [{name: tiny, config: tiny.yaml}]\n"
            "rows: [{name: all, paper: {psnr: 30}}, {name: bare, config: bare.yaml}]\n");
}

}  // namespace

TEST_CASE("jade_sweep: trains two rows with two seeds, goes on, and writes the tables",
          "[sweep][slow]") {
  const test::TempDir dir;
  write_sweep(dir);
  const std::string call = "--sweep sweep.yaml --output out --device cpu --jobs 2 ";
  const Outcome plan = run(dir, call + "--dry-run");
  INFO(plan.err);
  CHECK(plan.code == 0);
  CHECK_THAT(plan.out, Catch::Contains("new  all/tiny/0  steps 4") && Catch::Contains("4 runs"));
  CHECK_FALSE(std::filesystem::exists(dir / "out"));
  const Outcome first = run(dir, call);
  INFO(first.err);
  CHECK(first.code == 0);
  CHECK_THAT(first.out, test::naming("4 of 4", "0 failed", "0 unfinished"));
  const std::string table = read_file(dir / "out/table.md");
  const std::string page = read_file(dir / "out/index.html");
  for (const char* file : {"images/test_03.png", "images/truth_03.png", "report.html"}) {
    CHECK_THAT(page, Catch::Contains(concat("runs/all/tiny/0/", file)));
  }
  INFO(table);
  CHECK_THAT(table, Catch::Contains("4 of 4 runs finished. Steps: 4."));
  CHECK_THAT(table, !Catch::Contains("What is missing"));
  CHECK(std::filesystem::exists(dir / "out/runs/bare/tiny/1/point_cloud.ply"));
  const Outcome again = run(dir, call + "--json");
  CHECK(again.code == 0);
  CHECK_THAT(again.out, Catch::Contains("\"finished\":4"));
  for (const char* dry : {"", " --dry-run"}) {
    const Outcome changed = run(dir, call + "--set train.iterations=5" + dry);
    CHECK(changed.code == 2);
    CHECK_THAT(changed.err, Catch::Contains("bare/tiny/1: train.iterations: 4 -> 5"));
  }
}

TEST_CASE("jade_sweep: mistakes are refused before anything starts, all at once", "[sweep]") {
  const test::TempDir dir;
  write_sweep(dir);
  dir.write(
      "bad.yaml",
      "columns: [psnr]\nscenes: [{name: tiny, config: tiny.yaml, set: [dataset.path=nowhere]}]\n"
      "rows: [{name: a, set: [objective.dsim=1]}, {name: b, set: [train.iterations=many]}, {name: "
      "c},\n"
      "  {name: d, set: [objective.target=efnet, efnet.path=nowhere.pt]}, {name: e, set: "
      "[exposure.samples=6]},\n"
      "  {name: f, set: [densify.until=10, train.iterations=800]},\n"
      "  {name: g, set: [init.kind=ply, init.ply=nowhere.ply]},\n"
      "  {name: h, set: [dataset.mask=nowhere.png, dataset.events_file=nowhere.h5]},\n"
      "  {name: i, set: [objective.target=image_folder, objective.restored_poses=middle,\n"
      "  train.target_images=nowhere]}]\n");
  const Outcome outcome = run(dir, "--sweep bad.yaml --output out");
  INFO(outcome.err);
  CHECK(outcome.code == 2);
  for (const char* problem :
       {"objective.dsim: unknown key; did you mean objective.dssim?", "found 'many'",
        "scene tiny: dataset.path: expected", "row d: efnet.path: expected",
        "row e: exposure.samples", "row f: densify.until", "row g: init.ply: expected",
        "nowhere.ply", "row h: dataset.mask: expected", "row h: dataset.events_file: expected",
        "row i: train.target_images: expected"}) {
    CHECK_THAT(outcome.err, Catch::Contains(problem));
  }
  CHECK_FALSE(std::filesystem::exists(dir / "out"));
  CHECK(run(dir, "--sweep nowhere.yaml --output out").code == 2);
  CHECK(run(dir, "--sweep sweep.yaml").code == 2);
  CHECK(run(dir, "--sweep sweep.yaml --output out --train-program sweep.yaml").code == 2);
  CHECK_FALSE(std::filesystem::exists(dir / "out"));
  CHECK(run(dir, "--sweep sweep.yaml --output out --rows al").code == 2);
}

TEST_CASE("jade_sweep: flags that others make useless are refused", "[sweep]") {
  const test::TempDir dir;
  write_sweep(dir);
  for (const auto& [flags, named] : std::vector<std::pair<std::string, std::string>>{
           {"--slurm=--partition=gpu", "--slurm: expected with --launcher slurm"},
           {"--wait --launcher local", "--wait: expected with --launcher slurm"},
           {"--launcher slurm --memory-margin 2",
            "--memory-margin: expected with --launcher local"},
           {"--table --launcher slurm", "--launcher: expected without --table"},
           {"--table --dry-run", "--dry-run: expected without --table"},
           {"--dry-run --json", "--json: expected without --dry-run"}}) {
    const Outcome outcome = run(dir, "--sweep sweep.yaml --output out " + flags);
    INFO(flags << ": " << outcome.err);
    CHECK(outcome.code == 2);
    CHECK_THAT(outcome.err, Catch::Contains(named));
    CHECK(std::count(outcome.err.begin(), outcome.err.end(), '\n') == 1);
  }
  CHECK_FALSE(std::filesystem::exists(dir / "out"));
}
