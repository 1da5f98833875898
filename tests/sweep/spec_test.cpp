// SPDX-License-Identifier: Apache-2.0
#include "jade/sweep/spec.h"

#include "support/catch.h"

#include <fstream>

#include "fixture.h"
#include "support/naming.h"

using namespace jade;
using namespace jade::test;

TEST_CASE("read_spec: all problems at once, with their places and the nearest names", "[sweep]") {
  const TempDir dir;
  const auto file = dir.write("bad.yaml", R"(colums: [psnr]
columns: [psnr, sim]
seeds: [0, -1]
scenes: [{name: a, config: nowhere.yaml}]
rows:
  - {name: "x/y"}
  - {name: full, paper: {ssimm: 1}}
  - {name: full, run: maybe}
  - {name: quoted, paper_scenes: none}
jobs: 4294967297
)");
  const std::string all = problems_of([&] { sweep::read_spec(file); });
  INFO(all);
  for (const char* problem :
       {"bad.yaml:1:9: colums: unknown key; did you mean columns?",
        "found 'sim'; did you mean ssim?", "seeds: expected whole numbers of 0 or more, found '-1'",
        "no such file: ", "found 'x/y'", "ssimm is none of the columns", "two are named full",
        "run: expected true or false, found 'maybe'", "paper_scenes: expected figures by scene",
        "jobs: expected from 0 to 100000, found 4294967297"}) {
    CHECK_THAT(all, Catch::Contains(problem));
  }
  CHECK_THROWS_AS(sweep::read_spec(dir / "none.yaml"), ConfigError);
  CHECK_THROWS_AS(sweep::read_spec(dir.write("text.yaml", "rows: [")), ConfigError);
}

TEST_CASE("read_spec: what a file extends is read first, and each key of a later one wins whole",
          "[sweep]") {
  const TempDir dir;
  dir.write("shared/a.yaml", "");
  dir.write("shared/b.yaml", "");
  dir.write(
      "shared/scenes.yaml",
      "seeds: [7]\nset: [x=1]\nscenes: [{name: a, config: a.yaml}, {name: b, config: b.yaml}]\n");
  dir.write("base.yaml",
            "extends: shared/scenes.yaml\ntitle: Base\nseeds: [1, 2]\ncolumns: [psnr]\n");
  dir.write("more.yaml", "note: More\ncolumns: [ssim]\n");
  const sweep::Spec spec = sweep::read_spec(
      dir.write("own.yaml", "extends: [base.yaml, more.yaml]\nset: [y=2]\nrows: [{name: full}]\n"));
  CHECK(spec.name == "own");
  CHECK(spec.title == "Base");
  CHECK(spec.note == "More");
  CHECK(spec.seeds == std::vector<int64_t>{1, 2});
  CHECK(spec.set == std::vector<std::string>{"y=2"});
  REQUIRE(spec.columns.size() == 1);
  CHECK(spec.columns[0].key == "ssim");
  REQUIRE(spec.scenes.size() == 2);
  CHECK(spec.scenes[1].config == dir.path() / "shared/b.yaml");
  dir.write("few.yaml", "extends: own.yaml\nscenes: [{name: c, config: shared/a.yaml}]\n");
  CHECK(sweep::read_spec(dir / "few.yaml").scenes.size() == 1);
  CHECK(sweep::read_spec(dir / "few.yaml").rows.size() == 1);
}

TEST_CASE("read_spec: problems of an extended file stand in that file", "[sweep]") {
  const TempDir dir;
  dir.write("base.yaml", "columns: [psnr]\nrows: [{name: full, paper: {ssim: 1}}]\n");
  dir.write("scenes.yaml", "scenes:\n  - {name: a, confg: a.yaml}\n");
  const std::string all = problems_of([&] {
    sweep::read_spec(dir.write("own.yaml", "extends: [base.yaml, scenes.yaml]\ncolumns: [psnr]\n"));
  });
  INFO(all);
  CHECK_THAT(all, test::naming("scenes.yaml:2:22", "confg", "config?"));
  CHECK_THAT(all, test::naming("base.yaml:2:7", "rows: full: paper", "ssim"));
}

TEST_CASE("read_spec: extends in a circle, of nothing and of what is no path", "[sweep]") {
  const TempDir dir;
  const auto problem = [&](const std::string& yaml) {
    const auto file = dir.write("own.yaml", "title: Own\n" + yaml);
    return problems_of([&] { sweep::read_spec(file); });
  };
  dir.write("other.yaml", "extends: own.yaml\n");
  CHECK_THAT(
      problem("extends: other.yaml\n"),
      Catch::Contains("other.yaml:1:10: extends: goes in a circle: own.yaml -> other.yaml -> "
                      "own.yaml"));
  CHECK_THAT(problem("extends: own.yaml\n"), test::naming("own.yaml -> own.yaml"));
  CHECK_THAT(problem("extends: [none.yaml]\n"),
             test::naming("own.yaml:2:11: extends") && Catch::Contains("none.yaml"));
  CHECK_THAT(problem("extends: {a: b}\n"), test::naming("own.yaml:2:10: extends", "path"));
}

TEST_CASE("configs: every sweep that ships can be read, and overrides have at most six lines",
          "[sweep]") {
  const std::filesystem::path root = std::string(JADE_SOURCE) + "/configs";
  int sweeps = 0, overrides = 0;
  for (const auto& entry : std::filesystem::directory_iterator(root / "sweeps")) {
    if (entry.is_directory()) continue;
    INFO(entry.path());
    const sweep::Spec spec = sweep::read_spec(entry.path());
    CHECK_FALSE(spec.rows.empty());
    CHECK_FALSE(spec.scenes.empty());
    ++sweeps;
  }
  for (const char* folder : {"ablation", "baseline"}) {
    for (const auto& entry : std::filesystem::directory_iterator(root / folder)) {
      std::ifstream in(entry.path());
      const auto lines = std::count(std::istreambuf_iterator<char>(in), {}, '\n');
      INFO(entry.path());
      CHECK(lines <= 6);
      ++overrides;
    }
  }
  CHECK(sweeps == 20);
  CHECK(overrides == 21);
}

TEST_CASE("configs: the scenes of every list have their settings and can be made", "[sweep]") {
  const std::filesystem::path configs = std::string(JADE_SOURCE) + "/configs";
  const TempDir dir;
  for (const auto& entry : std::filesystem::directory_iterator(configs / "sweeps/scenes")) {
    INFO(entry.path());
    const auto file = dir.write("sweep.yaml", concat("extends: ", entry.path().string(),
                                                     "\ncolumns: [psnr]\nrows: [{name: full}]\n"));
    const sweep::Spec spec = sweep::read_spec(file);
    CHECK(spec.scenes.size() >= 4);
    for (const sweep::Scene& scene : spec.scenes) {
      INFO(scene.name);
      CHECK(std::filesystem::exists(scene.config));
      if (scene.make.empty()) continue;
      CHECK(std::filesystem::exists(configs / "simulate" / (scene.name + ".yaml")));
      CHECK_THAT(scene.make, Catch::Contains("configs/simulate/" + scene.name + ".yaml"));
      CHECK_THAT(scene.make, Catch::EndsWith("data/bench/" + scene.name));
    }
  }
}
