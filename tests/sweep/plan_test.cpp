// SPDX-License-Identifier: Apache-2.0
#include "jade/sweep/plan.h"

#include "support/catch.h"

#include "fixture.h"
#include "jade/core/error.h"
#include "support/naming.h"

using namespace jade;
using namespace jade::test;

namespace {

const std::string kScenes = "scenes: [{name: a, config: a.yaml}, {name: b, config: b.yaml}]\n";

}  // namespace

TEST_CASE("make_plan: every row, scene and seed, seed by seed, with later layers winning",
          "[sweep]") {
  const TempDir dir;
  dir.write("low.yaml", "train: {rate: 0.1, iterations: 100}\n");
  sweep::PlanOptions options;
  options.overrides = {"train.mode=quick"};
  const sweep::Plan plan = plan_of(dir, kScenes + R"(
columns: [psnr]
seeds: [0, 3]
set: [train.iterations=7]
rows:
  - {name: plain}
  - {name: low, config: low.yaml, set: [train.iterations=9], seeds: [3]}
  - {name: filed, config: low.yaml, seeds: [3]}
  - {name: quoted, run: false, paper: {psnr: 30}}
)",
                                   options);
  std::vector<std::string> ids;
  for (const sweep::Run& run : plan.runs) ids.push_back(run.id());
  CHECK(ids == std::vector<std::string>{"plain/a/0", "plain/b/0", "plain/a/3", "low/a/3",
                                        "filed/a/3", "plain/b/3", "low/b/3", "filed/b/3"});
  CHECK(plan.runs[0].value("train.iterations") == "7");
  CHECK(plan.runs[1].value("train.rate") == "0.25");
  CHECK(plan.runs[6].value("train.rate") == "0.1");
  CHECK(plan.runs[6].value("train.iterations") == "9");
  CHECK(plan.runs[6].value("train.mode") == "quick");
  CHECK(plan.runs[6].value("seed") == "3");
  // The sweep's own settings override a row's files.
  CHECK(plan.runs[7].value("train.iterations") == "7");
  CHECK(plan.runs[7].value("train.rate") == "0.1");
}

TEST_CASE("make_plan: the problems of all runs come at once, each told once", "[sweep]") {
  const TempDir dir;
  dir.write("typo.yaml", "train: {ratte: 0.1}\n");
  sweep::PlanOptions options;
  options.overrides = {"train.iterations=0"};
  const std::string all = problems_of([&] {
    plan_of(dir,
            kScenes +
                "columns: [psnr]\nseeds: [0, 1]\nrows: [{name: x, config: typo.yaml}, {name: y, "
                "set: [train.rate=2]}]\n",
            options);
  });
  INFO(all);
  // The fixture's resolver stops at a run's first bad layer, so the override is reported only if
  // nothing else is wrong.
  CHECK_THAT(all, test::naming("train.ratte", "train.rate?"));
  CHECK_THAT(all, Catch::Contains("row y: --set train.rate=2: "));
  CHECK_THAT(all, test::naming("train.rate", "0 to 1", "'2'"));
  CHECK(std::count(all.begin(), all.end(), '\n') == 1);
}

TEST_CASE(
    "make_plan: settings that do not go together are reported with their row, files with their own "
    "place",
    "[sweep]") {
  const TempDir dir;
  dir.write("typo", "train: {ratte: 0.1}\n");  // a settings file of any name
  const std::string all = problems_of([&] {
    plan_of(dir, kScenes +
                     "columns: [psnr]\nrows: [{name: x, config: typo}, {name: y, set: "
                     "[train.mode=rest]}]\n");
  });
  INFO(all);
  CHECK_THAT(all, test::naming("row y: train.mode", "10 steps"));
  CHECK_THAT(all, Catch::Contains("typo:1:9: train.ratte") && !Catch::Contains("row x"));
}

TEST_CASE("make_plan: names on the command line that the sweep lacks are refused", "[sweep]") {
  const TempDir dir;
  sweep::PlanOptions options;
  options.rows = {"ful"};
  options.scenes = {"b"};
  options.data = {{"c", "/tmp"}};
  const std::string yaml = kScenes + "columns: [psnr]\nrows: [{name: full}, {name: half}]\n";
  const std::string all = problems_of([&] { plan_of(dir, yaml, options); });
  CHECK_THAT(all, test::naming("--rows", "ful;", "full?"));
  CHECK_THAT(all, test::naming("--data c"));
  options.rows = {"half"};
  options.data.clear();
  options.seeds = {5};
  const sweep::Plan plan = plan_of(dir, yaml, options);
  REQUIRE(plan.runs.size() == 1);
  CHECK(plan.runs[0].id() == "half/b/5");
}

TEST_CASE("make_plan: a seed among the settings would be ignored and is refused", "[sweep]") {
  const TempDir dir;
  sweep::PlanOptions options;
  options.overrides = {"seed=5"};
  const std::string all = problems_of([&] {
    plan_of(dir,
            "columns: [psnr]\nset: [seed=6]\nscenes: [{name: a, config: a.yaml, set: [seed=7]}]\n"
            "rows: [{name: x, set: [seed=8]}]\n",
            options);
  });
  INFO(all);
  CHECK(std::count(all.begin(), all.end(), '\n') == 3);
  for (const char* found : {"--set: expected no seed", "found seed=5; use seeds: or --seeds",
                            "found seed=6", "scene a: set: ", "row x: set: "}) {
    CHECK_THAT(all, Catch::Contains(found));
  }
}

TEST_CASE("make_plan: missing data is refused with the way to get it, or left out on request",
          "[sweep]") {
  const TempDir dir;
  const std::string yaml =
      "columns: [psnr]\nscenes:\n  - {name: a, config: a.yaml}\n"
      "  - {name: b, config: b.yaml, set: [dataset.path=/nowhere/x], make: \"make_it b\"}\nrows: "
      "[{name: full}]\n";
  const std::string all = problems_of([&] { plan_of(dir, yaml); });
  CHECK_THAT(all, Catch::Contains(
                      "scene b: dataset.path: expected /nowhere/x; make it with make_it b, or name "
                      "its folder with --data b=DIR"));
  sweep::PlanOptions options;
  options.skip_missing = true;
  const sweep::Plan plan = plan_of(dir, yaml, options);
  CHECK(plan.runs.size() == 1);
  REQUIRE(plan.skipped.size() == 1);
  CHECK_THAT(plan.skipped[0], Catch::Contains("full/b/0: dataset.path"));
  options = {};
  std::filesystem::create_directories(dir / "it's here");
  options.data = {{"b", dir / "it's here"}};
  CHECK(plan_of(dir, yaml, options).runs.size() == 2);
}

TEST_CASE("make_plan: without scenes the base configuration is the scene", "[sweep]") {
  const TempDir dir;
  const std::string yaml = "columns: [psnr]\nrows: [{name: full}]\n";
  CHECK_THAT(problems_of([&] { plan_of(dir, yaml); }), test::naming("--config scene.yaml"));
  sweep::PlanOptions options;
  options.base = {dir / "b.yaml"};
  const sweep::Plan plan = plan_of(dir, yaml, options);
  REQUIRE(plan.runs.size() == 1);
  CHECK(plan.runs[0].id() == "full/b/0");
  CHECK(plan.runs[0].value("train.iterations") == "20");
}
