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
  CHECK_THAT(all, Catch::Contains("/test.yaml:4:54: row y: set: train.rate=2: "));
  CHECK_THAT(all, test::naming("train.rate", "0 to 1", "'2'"));
  CHECK(std::count(all.begin(), all.end(), '\n') == 1);
}

TEST_CASE("make_plan: a value of any set is reported with its place and owner", "[sweep]") {
  const TempDir dir;
  const auto problem = [&](const std::string& yaml) {
    return problems_of([&] { plan_of(dir, "columns: [psnr]\n" + yaml); });
  };
  const std::string scenes = "scenes:\n  - {name: a, config: a.yaml}\n";
  CHECK_THAT(problem(scenes + "set:\n  - train.rate=3\nrows: [{name: x}]\n"),
             Catch::Contains("test.yaml:5:5: set: train.rate=3: train.rate: expected"));
  CHECK_THAT(
      problem("scenes:\n  - {name: a, config: a.yaml, set: train.rate=3}\nrows: [{name: x}]\n"),
      Catch::Contains("test.yaml:3:36: scene a: set: train.rate=3: "));
  CHECK_THAT(
      problem(scenes +
              "rows:\n  - name: x\n    set:\n      - train.mode=quick\n      - train.rat=1\n"),
      Catch::Contains("test.yaml:8:9: row x: set: train.rat=1: train.rat: unknown key"));
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

TEST_CASE("make_plan: a column of a step at which no run evaluates is refused", "[sweep]") {
  const TempDir dir;  // scene a has 10 steps, b 20; both evaluate every 5
  const auto problems = [&](const std::string& columns, const std::string& rows,
                            const sweep::PlanOptions& options = {}) {
    return problems_of([&] {
      plan_of(dir, concat(kScenes, "columns: [", columns, "]\nrows: [", rows, "]\n"), options);
    });
  };
  CHECK(problems("psnr, psnr@5, ssim@15, psnr@10, psnr@20, minutes@20", "{name: x}").empty());
  CHECK(problems("psnr@3", "{name: x}, {name: y, set: [train.evaluate_every=3]}").empty());
  CHECK(problems("psnr@13", "{name: x}, {name: y, set: [train.iterations=13]}").empty());
  const std::string all = problems("psnr@3, ssim@25, psnr@005, gaussians@5", "{name: x}");
  INFO(all);
  CHECK(std::count(all.begin(), all.end(), '\n') == 3);
  CHECK_THAT(all, Catch::Contains("columns: psnr@3: no evaluation at step 3, found runs of 10 "
                                  "steps with train.evaluate_every 5"));
  CHECK_THAT(all, test::naming("ssim@25", "psnr@005", "set train.evaluate_every"));
  CHECK_THAT(all, Catch::Contains("gaussians@5: expected the last step"));
  sweep::PlanOptions options;
  options.overrides = {"train.evaluate_every=0"};
  CHECK_THAT(problems("psnr@5, psnr@20", "{name: x}", options),
             test::naming("psnr@5") && !test::naming("psnr@20"));
  // Other rows may fill the column, and a row that cannot be read might.
  options.overrides.clear();
  options.rows = {"x"};
  const std::string two = "{name: x}, {name: y, set: [train.evaluate_every=3]}";
  CHECK(problems("psnr@3", two, options).empty());
  CHECK_THAT(problems("psnr@3", "{name: x}, {name: y, set: [train.rate=2]}"),
             test::naming("row y") && !test::naming("psnr@3"));
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
