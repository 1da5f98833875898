// SPDX-License-Identifier: Apache-2.0
// jade_bench from the command line: time to quality.
#include "support/catch.h"

#include <nlohmann/json.hpp>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
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

const std::string kRun =
    "jade_bench --quiet --device cpu --json run --set dataset.path=scene --set init.points=100 "
    "--set objective.target=edi --set exposure.samples=5 --set train.iterations=5 "
    "--set train.log_every=1 --output run --every 2";

const std::string kAllMoments =
    " --set train.quarter_moments_until=0 --set train.half_moments_until=0";

}  // namespace

TEST_CASE("jade_bench run: the first score at a goal or above, and what came before", "[apps]") {
  const test::TempDir dir;
  test::write_tiny_dataset(dir / "scene");
  const Outcome outcome = run(dir, kRun + " --psnr 1,99");
  INFO(outcome.err);
  REQUIRE(outcome.code == 0);
  const auto result = nlohmann::json::parse(outcome.out);
  const auto& curve = result["curve"];
  REQUIRE(curve.size() == 3);
  double before = result["prepare_seconds"].get<double>();
  CHECK(before > 0);
  const int64_t steps[] = {2, 4, 5};
  for (size_t i = 0; i < 3; ++i) {
    CHECK(curve[i]["step"] == steps[i]);
    CHECK(curve[i]["seconds"].get<double>() > before);
    before = curve[i]["seconds"].get<double>();
    CHECK(curve[i]["psnr"].get<double>() > 1);
  }
  REQUIRE(result["goals"].size() == 2);
  CHECK(result["goals"][0]["psnr"] == 1);
  CHECK(result["goals"][0]["reached"] == curve[0]);
  CHECK(result["goals"][1]["reached"].is_null());
  CHECK(result["last"] == curve[2]);
  CHECK_THAT(read_file(dir / "run/curve.csv"), Catch::StartsWith("step,seconds,psnr\n2,"));
  // Only steps: no checkpoint, no report.
  CHECK_FALSE(std::filesystem::exists(dir / "run/checkpoints"));
  CHECK_FALSE(std::filesystem::exists(dir / "run/report.html"));
}

TEST_CASE("jade_bench run: what a run starts from, for other programs", "[apps]") {
  const test::TempDir dir;
  test::write_tiny_dataset(dir / "scene");
  const Outcome written =
      run(dir, kRun + " --set objective.restored_poses=middle --write-input input" + kAllMoments);
  INFO(written.err);
  REQUIRE(written.code == 0);
  const auto numbers = nlohmann::json::parse(read_file(dir / "input/training.json"));
  CHECK(numbers["iterations"] == 5);
  CHECK(io::read_npy(dir / "input/means.npy").size(0) == 100);
  const torch::Tensor blurry = io::read_npy(dir / "input/blurry.npy");
  const torch::Tensor factors = io::read_npy(dir / "input/edi_factors.npy");
  CHECK(io::read_npy(dir / "input/targets.npy").sizes() == blurry.sizes());
  CHECK(factors.size(0) == blurry.size(0));
  CHECK(factors.size(1) == 5);
  check_error(run(dir,
                  "jade_bench --quiet --device cpu run --set dataset.path=scene --set "
                  "init.points=100 --set objective.target=routed --set allocation.kind=router "
                  "--set objective.restored_poses=middle --output routed --write-input other"),
              2, "--write-input: expected a target at mid-exposure that no router decides");
  check_error(run(dir, kRun + " --set objective.restored_poses=middle --write-input other"), 2,
              "--write-input: expected steps with all moments");
}

TEST_CASE("jade_bench run: what it needs, in one line", "[apps]") {
  const test::TempDir dir;
  REQUIRE(run(dir,
              "jade_simulate --quiet --set simulate.exposures=2 --set simulate.test_views=0 --set "
              "simulate.seen_test_views=0 "
              "--set simulate.width=36 --set simulate.height=28 --set simulate.focal_px=40 "
              "--set simulate.motion.blur_px=3 --output scene")
              .code == 0);
  // A warning about the data precedes it.
  const Outcome unscored = run(dir, kRun);
  CHECK(unscored.code == 3);
  CHECK_THAT(unscored.err, test::naming("scene", "test views"));
  check_error(run(dir, "jade_bench --quiet run --set dataset.path=scene"), 2, "--output");
  CHECK(run(dir, kRun + " --every 0").code == 2);
}

TEST_CASE("jade_bench quality: when each run first reached a goal, seeds as one", "[apps]") {
  const test::TempDir dir;
  const auto write_run = [&](const std::string& run, const std::string& lines, double end) {
    std::filesystem::create_directories(dir / run);
    write_file(dir / (run + "/metrics.jsonl"), lines);
    write_file(dir / (run + "/eval.json"), jade::concat("{\"mean\": {\"psnr\": ", end, "}}"));
  };
  write_run("new/desk/0",
            "{\"step\": 10, \"seconds\": 2.0, \"test_psnr\": 27}\n"
            "{\"step\": 20, \"seconds\": 3.0, \"test_psnr\": 29}\n"
            "{\"step\": 40, \"seconds\": 5.0, \"loss\": 1}\nhalf a li",
            31);
  write_run("new/desk/1", "{\"step\": 20, \"seconds\": 4.0, \"test_psnr\": 28}\n", 29.5);
  write_run("old", "{\"step\": 9, \"seconds\": 7.0, \"loss\": 1}\n", 20);
  const Outcome outcome =
      run(dir, "jade_bench --json quality new old --psnr 28,30 --csv table.csv");
  INFO(outcome.err);
  REQUIRE(outcome.code == 0);
  const auto groups = nlohmann::json::parse(outcome.out);
  REQUIRE(groups.size() == 2);
  CHECK(groups[0]["run"] == "new/desk");
  CHECK(groups[0]["goals"][0]["seconds"] == 3.5);
  CHECK(groups[0]["goals"][0]["step"] == 20);
  CHECK(groups[0]["goals"][1]["reached"] == 1);
  CHECK(groups[0]["goals"][1]["seconds"] == 5);
  CHECK(groups[0]["end"]["psnr"] == 30.25);
  CHECK(groups[1]["goals"][0]["reached"] == 0);
  CHECK_THAT(read_file(dir / "table.csv"),
             Catch::StartsWith("run,goal,seconds,step,psnr\nnew/desk/0,28,3.000,20,29.000\n") &&
                 Catch::Contains("new/desk/1,30,,,\n") && Catch::Contains("old,,7.000,9,20.000"));
  check_error(run(dir, "jade_bench quality nowhere"), 3, "nowhere: expected a run of jade_train");
  std::filesystem::create_directories(dir / "older");
  write_file(dir / "older/metrics.jsonl", "{\"step\": 1, \"loss\": 1}\n");
  check_error(run(dir, "jade_bench quality older"), 3, "expected lines with \"seconds\"");
}

TEST_CASE("jade_bench losses: a term that is none is named beside those that are", "[apps]") {
  const test::TempDir dir;
  check_error(run(dir, "jade_bench losses --device cpu --term gray,scene --repeats 1 --warm-up 0"),
              2, "--term", "rec, target");
}
