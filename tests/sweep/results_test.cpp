// SPDX-License-Identifier: Apache-2.0
#include "jade/sweep/results.h"

#include "support/catch.h"

#include <nlohmann/json.hpp>

#include "fixture.h"
#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/sweep/cell_text.h"
#include "support/naming.h"

using namespace jade;
using namespace jade::test;

namespace {

const std::string kSweep = R"(title: Test
paper_source: "Table 9"
columns: [psnr, ssim, memory_gib, lpips_vgg, psnr@5]
seeds: [0, 1, 2]
scenes: [{name: a, config: a.yaml}, {name: b, config: b.yaml}]
rows:
  - {name: full, title: "Full, α", paper: {psnr: 34.5}, paper_scenes: {c: {ssim: 0.75}}}
  - {name: half}
  - {name: other, run: false, paper: {psnr: 31}}
)";

void finish(const TempDir& dir, const std::string& id, double psnr, double ssim) {
  const std::string run = "out/runs/" + id;
  dir.write(run + "/point_cloud.ply", "");
  dir.write(run + "/eval.json", concat(R"({"mean": {"psnr": )", psnr, R"(, "ssim": )", ssim,
                                       R"(, "lpips_vgg": null}})"));
  dir.write(run + "/metrics.jsonl",
            "{\"step\": 5, \"memory_bytes\": 1073741824}\n{\"step\": 5, \"test_psnr\": 20}\n"
            "{\"step\": 9, \"memory_bytes\": 536870912}\nhalf a li");
}

/// full: all but b/2; half: only a/0, and a/1 diverged.
sweep::Table table_of(const TempDir& dir) {
  finish(dir, "full/a/0", 30, 0.5);
  finish(dir, "full/a/1", 32, 0.5);
  finish(dir, "full/a/2", 37, 0.5);
  finish(dir, "full/b/0", 20, 0.7);
  finish(dir, "full/b/1", 24, 0.7);
  finish(dir, "half/a/0", 33, 0.5);
  finish(dir, "gone/a/0", 1, 1);
  const sweep::SweepOutput output(dir / "out");
  sweep::Outcome diverged;
  diverged.attempts = 1;
  diverged.exit_code = 5;
  diverged.reason = "step 7: NaN";
  output.write_outcome("half/a/1", diverged);
  return sweep::gather(plan_of(dir, kSweep), output);
}

}  // namespace

TEST_CASE("number: thousands are apart, and what is not zero does not look like it", "[sweep]") {
  CHECK(sweep::number(1234567.4, 0) == "1,234,567");
  CHECK(sweep::number(1234.5, 1) == "1234.5");
  CHECK(sweep::number(3.2e-5, 4) == "0.00003");
  CHECK(sweep::number(0, 2) == "0.00");
}

TEST_CASE("cell_of: mean and sample deviation of what is there", "[sweep]") {
  const sweep::Cell cell = sweep::cell_of({2.0, 4.0, std::nullopt, 9.0});
  CHECK(cell.count == 3);
  CHECK(cell.expected == 4);
  CHECK(*cell.mean == Approx(5));
  CHECK(*cell.deviation == Approx(std::sqrt((9 + 1 + 16) / 2.0)));
  CHECK_FALSE(sweep::cell_of({1.0}).deviation);
  CHECK_FALSE(sweep::cell_of({std::nullopt}).mean);
}

TEST_CASE("gather: averages take whole seeds only, and every gap is reported", "[sweep]") {
  const TempDir dir;
  const sweep::Table table = table_of(dir);
  const sweep::TableRow& full = table.rows[0];
  const sweep::Cell& a = full.scenes.at("a").at("psnr");
  CHECK(*a.mean == Approx(33));
  CHECK(*a.deviation == Approx(std::sqrt((9 + 1 + 16) / 2.0)));
  // Seeds 0 and 1: (30 + 20) / 2 and (32 + 24) / 2; seed 2 lacks scene b.
  const sweep::Cell& average = full.average.at("psnr");
  CHECK(*average.mean == Approx(26.5));
  CHECK(*average.deviation == Approx(std::sqrt(2 * 1.5 * 1.5)));
  CHECK(average.count == 2);
  CHECK(average.expected == 3);
  CHECK(*full.average.at("memory_gib").mean == Approx(1));
  CHECK(*full.average.at("psnr@5").mean == Approx(20));
  CHECK_FALSE(table.rows[1].average.at("psnr").mean);
  std::string remarks;
  for (const std::string& remark : table.remarks) remarks += remark + "\n";
  INFO(remarks);
  for (const char* remark :
       {"full/b/2: new\n", "half/a/1: failed: diverged (exit 5): step 7: NaN\n",
        "lpips_vgg: not measured by all finished runs", "though in its folder: gone/a/0\n"}) {
    CHECK_THAT(remarks, Catch::Contains(remark));
  }
}

TEST_CASE("gather: runs that the flags leave out are told apart from those of other sweeps",
          "[sweep]") {
  const TempDir dir;
  table_of(dir);
  sweep::PlanOptions options;
  options.rows = {"half"};
  options.seeds = {1};
  const sweep::Table table =
      sweep::gather(plan_of(dir, kSweep, options), sweep::SweepOutput(dir / "out"));
  std::string remarks;
  for (const std::string& remark : table.remarks) remarks += remark + "\n";
  INFO(remarks);
  CHECK_THAT(remarks, Catch::Contains("--rows, --scenes, --seeds or --skip-missing leave them out: "
                                      "full/a/0, full/a/1, "));
  CHECK_THAT(remarks, Catch::Contains("though in its folder: gone/a/0\n"));
}

TEST_CASE("gather: a damaged file of a run is named with what to do", "[sweep]") {
  const TempDir dir;
  table_of(dir);
  dir.write("out/runs/full/a/0/eval.json", "{\"mean\": {\"ps");
  CHECK_THROWS_NAMING(DataError,
                      sweep::gather(plan_of(dir, kSweep), sweep::SweepOutput(dir / "out")),
                      "full/a/0/eval.json: expected a JSON object", "found a damaged file",
                      "remove " + (dir / "out/runs/full/a/0").string() + " and");
}

TEST_CASE("standing_of: runs are counted, and the first failed one gives the exit code",
          "[sweep]") {
  const TempDir dir;
  const sweep::SweepOutput output(dir / "out");
  const sweep::Standing standing = sweep::standing_of(table_of(dir), output);
  CHECK(standing.runs == 12);
  CHECK(standing.finished == 6);
  CHECK(standing.failed == 1);
  CHECK(standing.unfinished == 5);
  CHECK(standing.code == ExitCode::kNumeric);
}

TEST_CASE("standing_of: a run that was killed gives an exit code too", "[sweep]") {
  const TempDir dir;
  const sweep::SweepOutput output(dir / "out");
  sweep::Outcome killed;
  killed.attempts = 1;
  killed.signal = 9;
  output.write_outcome("full/a/0", killed);
  const sweep::Standing standing =
      sweep::standing_of(sweep::gather(plan_of(dir, kSweep), output), output);
  CHECK(standing.failed == 0);
  CHECK(standing.code == ExitCode::kDevice);
}

TEST_CASE("tables: ours and the paper's side by side, gaps marked, in three formats", "[sweep]") {
  const TempDir dir;
  const sweep::Table table = table_of(dir);
  const std::string markdown = sweep::to_markdown(table);
  INFO(markdown);
  CHECK_THAT(markdown, Catch::Contains("6 of 12 runs finished"));
  CHECK_THAT(markdown,
             Catch::Contains("| Full, α | 26.50 ± 2.12 (2/3) | *34.50* | 0.6000 ± 0.0000 (2/3) |"));
  CHECK_THAT(markdown, Catch::Contains("| half | – (0/3) | | – (0/3) |"));
  CHECK_THAT(markdown, Catch::Contains("| other (quoted) | – | *31.00* |"));
  CHECK_THAT(markdown, Catch::Contains("| Full, α | **33.00** ± 3.61 |"));
  CHECK_THAT(markdown, Catch::Contains("## c (quoted from the paper; not run here)"));
  const std::string csv = sweep::to_csv(table);
  INFO(csv);
  CHECK_THAT(csv, Catch::Contains("full,\"Full, α\",average,psnr,26.5,2.121320344,2,3,34.5\n"));
  CHECK_THAT(csv, Catch::Contains("full,\"Full, α\",c,ssim,,,0,0,0.75\n"));
  CHECK_THAT(csv, Catch::Contains("other,other,average,psnr,,,0,0,31\n"));
  CHECK_THAT(sweep::runs_csv(table),
             Catch::Contains("half,a,1,failed,diverged (exit 5): step 7: NaN,,,,,\n"));
  const std::string latex = sweep::to_latex(table);
  INFO(latex);
  CHECK_THAT(
      latex,
      Catch::Contains("Full, $\\alpha$ & 26.50 {\\scriptsize$\\pm$}2.12 (2/3) & \\emph{34.50} &"));
  CHECK_THAT(latex, Catch::Contains("% missing: full/b/2: new\n"));
  sweep::Table special = table;
  special.rows[0].title = "a\\b {c} ~d^e $f";
  CHECK_THAT(sweep::to_latex(special),
             Catch::Contains("a\\textbackslash{}b \\{c\\} \\textasciitilde{}d"
                             "\\textasciicircum{}e \\$f & "));
  sweep::write_table(table, dir / "out");
  CHECK(read_file(dir / "out/table.md") == markdown);
  sweep::Table barred = table;
  barred.rows[0].title = "p|q";
  CHECK_THAT(sweep::to_markdown(barred), Catch::Contains("| p\\|q |"));
}

TEST_CASE("tables: seen and unseen test views have columns, empty for runs without them",
          "[sweep]") {
  const std::string sweep = R"(columns: [psnr, psnr_seen, psnr_unseen, psnr_seen@5]
scenes: [{name: a, config: a.yaml}]
rows: [{name: new}, {name: old}, {name: unknown}]
)";
  const TempDir dir;
  for (const char* row : {"new", "old", "unknown"}) finish(dir, concat(row, "/a/0"), 30, 0.5);
  dir.write("out/runs/new/a/0/eval.json",
            R"({"mean": {"psnr": 30}, "mean_seen": {"psnr": 33.25}, "mean_unseen": {"psnr": 28}})");
  dir.write("out/runs/new/a/0/metrics.jsonl", R"({"step": 5, "test_psnr_seen": 24.5})");
  dir.write("out/runs/unknown/a/0/eval.json",
            R"({"mean": {"psnr": 30}, "mean_seen": null, "mean_unseen": null})");
  const sweep::Table table = sweep::gather(plan_of(dir, sweep), sweep::SweepOutput(dir / "out"));
  const std::string markdown = sweep::to_markdown(table);
  INFO(markdown);
  CHECK_THAT(markdown, Catch::Contains("PSNR (global), seen ↑ | PSNR (global), unseen ↑ |"));
  CHECK_THAT(markdown, Catch::Contains("| new | **30.00** | **33.25** | **28.00** | **24.50** |"));
  for (const char* row : {"old", "unknown"}) {
    CHECK_THAT(markdown, Catch::Contains(concat("| ", row, " | **30.00** | – (0/1) | – (0/1) |")));
  }
  CHECK_THAT(markdown, Catch::Contains("psnr_seen: not measured by old/a/0, unknown/a/0"));
  CHECK_THAT(sweep::to_csv(table), Catch::Contains("new,new,a,psnr_unseen,28,,1,1,\n"));
  CHECK_THAT(sweep::runs_csv(table), Catch::Contains("new,a,0,finished,,30,33.25,28,24.5\n"));
  const std::string latex = sweep::to_latex(table);
  INFO(latex);
  CHECK_THAT(latex, Catch::Contains("\\textbf{30.00} & \\textbf{33.25} & \\textbf{28.00}"));
}

TEST_CASE("tables: what an allocation chose has columns, empty for runs that cannot tell",
          "[sweep]") {
  const TempDir dir;
  for (const char* row : {"told", "unknown"}) finish(dir, concat(row, "/a/0"), 30, 0.5);
  dir.write("out/runs/told/a/0/allocation.json",
            R"({"views": [], "mean": {"choice_right": 0.625, "choice_gain_db": -0.25}})");
  dir.write("out/runs/unknown/a/0/allocation.json",
            R"({"views": [], "mean": {"choice_right": null, "choice_gain_db": null}})");
  const sweep::Table table = sweep::gather(plan_of(dir, R"(columns: [choice_right, choice_gain_db]
scenes: [{name: a, config: a.yaml}]
rows: [{name: told}, {name: unknown}]
)"),
                                           sweep::SweepOutput(dir / "out"));
  const std::string markdown = sweep::to_markdown(table);
  INFO(markdown);
  CHECK_THAT(markdown, Catch::Contains("| told | **0.6250** | **-0.25** |"));
  CHECK_THAT(markdown, Catch::Contains("choice_right: not measured by unknown/a/0"));
}

namespace {

/// Data that the page embeds.
nlohmann::json page_data(const std::string& page) {
  const std::string mark = "id=\"data\">";
  const size_t from = page.find(mark) + mark.size();
  return nlohmann::json::parse(page.substr(from, page.find("</script>", from) - from));
}

/// A finished run with a seen and an unseen view.
void finish_with_views(const TempDir& dir, const std::string& id, double psnr) {
  finish(dir, id, psnr, 0.5);
  const std::string run = "out/runs/" + id;
  dir.write(run + "/eval.json",
            concat(R"({"mean": {"psnr": )", psnr, R"(}, "views": [{"name": "3 a", "seen": true, )",
                   R"("psnr": )", psnr + 1, R"(}, {"name": "4", "seen": false, "psnr": )", psnr - 1,
                   "}]}"));
  dir.write(run + "/report.html", "");
  dir.write(run + "/images/test_3 a.png", "");
  dir.write(run + "/images/truth_3 a.png", "");
}

}  // namespace

TEST_CASE("page: links what the runs have, and shows what failed and what is missing", "[sweep]") {
  const TempDir dir;
  table_of(dir);
  finish_with_views(dir, "full/a/0", 30);
  finish_with_views(dir, "half/a/0", 33);
  dir.write("out/runs/half/a/0/images/test_4.png", "");
  const sweep::SweepOutput output(dir / "out");
  const sweep::Table table = sweep::gather(plan_of(dir, kSweep), output);
  sweep::write_table(table, dir / "out");
  const std::string page = read_file(dir / "out/index.html");
  CHECK(page == sweep::to_page(table, dir / "out"));
  const auto data = page_data(page);
  CHECK(data["title"] == "Test");
  CHECK(data["finished"] == 6);
  CHECK(data["runs_total"] == 12);
  REQUIRE(data["rows"].size() == 2);  // the quoted one has no runs
  CHECK(data["rows"][0]["title"] == "Full, α");

  const auto& views = data["scenes"][0]["views"];
  REQUIRE(views.size() == 2);
  CHECK(views[0]["name"] == "3 a");
  CHECK(views[0]["seen"] == true);
  CHECK(views[0]["truth"] == "runs/full/a/0/images/truth_3 a.png");
  CHECK(views[1]["seen"] == false);
  CHECK(views[1]["truth"].is_null());
  CHECK(data["scenes"][1]["views"].empty());
  const auto run_of = [&](const char* row, const char* scene, int seed) {
    for (const auto& run : data["runs"]) {
      if (run["row"] == row && run["scene"] == scene && run["seed"] == seed) return run;
    }
    return nlohmann::json();
  };
  const auto full = run_of("full", "a", 0);
  CHECK(full["state"] == "finished");
  CHECK(full["report"] == "runs/full/a/0/report.html");
  CHECK(full["views"]["3 a"]["src"] == "runs/full/a/0/images/test_3 a.png");
  CHECK(full["views"]["3 a"]["psnr"] == 31.0);
  CHECK(full["views"]["4"]["src"].is_null());
  CHECK(run_of("half", "a", 0)["views"]["4"]["src"] == "runs/half/a/0/images/test_4.png");
  CHECK(run_of("full", "a", 1)["report"].is_null());
  CHECK(run_of("half", "a", 1)["state"] == "failed");
  CHECK(run_of("half", "a", 1)["reason"] == "diverged (exit 5): step 7: NaN");
  CHECK(run_of("full", "b", 2)["state"] == "new");

  const auto& averages = data["tables"][0];
  CHECK(averages["title"] == "Average over 2 scenes (a, b)");
  CHECK(averages["paper"][0] == true);
  CHECK(averages["rows"][0]["cells"][0]["text"] == "26.50 ± 2.12 (2/3)");
  CHECK(averages["rows"][0]["cells"][0]["gap"] == true);
  CHECK(averages["rows"][0]["cells"][0]["mean"] == 26.5);
  CHECK(averages["rows"][0]["cells"][0]["deviation"].get<double>() == Approx(2.1213).margin(1e-3));
  CHECK(averages["rows"][2]["cells"][0]["mean"].is_null());
  CHECK(data["columns"][0]["noise"] == 0.3);
  CHECK(averages["rows"][0]["cells"][0]["paper"] == "34.50");
  CHECK(averages["rows"][2]["title"] == "other (quoted)");
  CHECK(data["tables"][1]["rows"].size() == 2);  // nothing is quoted for this scene
  CHECK(data["tables"][1]["rows"][0]["cells"][0]["best"] == true);
  CHECK(data["tables"][1]["rows"][1]["cells"][0]["best"] == false);
  CHECK(data["tables"][3]["title"] == "c (quoted from the paper; not run here)");
  CHECK(data["remarks"].size() == table.remarks.size());
}

TEST_CASE("gather: a damaged result is an error, not a gap", "[sweep]") {
  const TempDir dir;
  finish(dir, "full/a/0", 30, 0.5);
  dir.write("out/runs/full/a/0/eval.json", "{\"mean\": ");
  CHECK_THROWS_AS(sweep::gather(plan_of(dir, kSweep), sweep::SweepOutput(dir / "out")), DataError);
}
