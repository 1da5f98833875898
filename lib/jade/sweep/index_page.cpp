// SPDX-License-Identifier: Apache-2.0
// index.html: the data of page::sweep_page() from a table and the runs' pictures.
#include <algorithm>
#include <nlohmann/json.hpp>

#include "jade/core/atomic_file.h"
#include "jade/page/page.h"
#include "jade/sweep/cell_text.h"
#include "jade/sweep/results.h"

namespace jade::sweep {
namespace {

namespace fs = std::filesystem;
using PageJson = nlohmann::ordered_json;

/// Files of a run, as paths from the sweep's folder.
class RunFiles {
 public:
  RunFiles(const fs::path& folder, const RunRow& run)
      : folder_(folder), run_("runs/" + Run::concat_id(run.row, run.scene, run.seed)) {}

  /// The path of a file, or null if it does not exist.
  PageJson link(const std::string& name) const {
    const std::string path = run_ + "/" + name;
    return fs::exists(folder_ / path) ? PageJson(path) : PageJson(nullptr);
  }
  /// The views of eval.json; none if it is missing.
  PageJson scored_views() const {
    const fs::path path = folder_ / run_ / "eval.json";
    if (!fs::exists(path)) return PageJson::array();
    const PageJson json = PageJson::parse(read_file(path), nullptr, /*allow_exceptions=*/false);
    return json.is_object() ? json.value("views", PageJson::array()) : PageJson::array();
  }

 private:
  fs::path folder_;
  std::string run_;
};

PageJson run_entry(const RunRow& run, const RunFiles& files) {
  PageJson views = PageJson::object();
  if (run.state == RunState::kFinished) {
    for (const PageJson& view : files.scored_views()) {
      const std::string name = view.value("name", "");
      views[name] = {{"psnr", view.contains("psnr") ? view["psnr"] : PageJson(nullptr)},
                     {"src", files.link("images/test_" + name + ".png")}};
    }
  }
  return {{"row", run.row},     {"scene", run.scene},
          {"seed", run.seed},   {"state", to_string(run.state)},
          {"reason", run.word}, {"report", files.link("report.html")},
          {"views", views}};
}

/// The test views of a scene with their true images, from the first runs that have them.
PageJson scene_entry(const Table& table, const std::string& scene, const fs::path& folder) {
  PageJson views = PageJson::array();
  const auto find = [&](const PageJson& name) {
    return std::find_if(views.begin(), views.end(),
                        [&](const PageJson& view) { return view["name"] == name; });
  };
  for (const RunRow& run : table.runs) {
    if (run.scene != scene || run.state != RunState::kFinished) continue;
    const RunFiles files(folder, run);
    for (const PageJson& view : files.scored_views()) {
      const std::string name = view.value("name", "");
      auto known = find(name);
      if (known == views.end()) {
        views.push_back({{"name", name},
                         {"seen", view.contains("seen") ? view["seen"] : PageJson(nullptr)},
                         {"truth", nullptr}});
        known = views.end() - 1;
      }
      if ((*known)["truth"].is_null()) {
        (*known)["truth"] = files.link("images/truth_" + name + ".png");
      }
    }
  }
  return {{"name", scene}, {"views", views}};
}

/// Whether the paper has a figure of this row; `scene` empty: the average.
bool is_quoted(const TableRow& row, const std::string& scene) {
  return scene.empty() ? !row.paper.empty() : row.paper_scenes.count(scene) > 0;
}

/// `scene` empty: the averages.
PageJson table_entry(const Table& table, const std::string& scene, const std::string& title) {
  PageJson papers = PageJson::array(), rows = PageJson::array();
  for (const Column& column : table.columns) papers.push_back(has_paper(table, scene, column.key));
  for (const TableRow& row : table.rows) {
    if (!row.run && !is_quoted(row, scene)) continue;
    PageJson cells = PageJson::array();
    for (const Column& column : table.columns) {
      const Cell& cell = cell_at(row, scene, column.key);
      const std::string best = best_of(table, scene, column);
      const bool whole = cell.mean && cell.count == cell.expected;
      const auto figure = paper_at(row, scene, column.key);
      cells.push_back(
          {{"text", cell_text(row, cell, column, best, kPlain)},
           {"best", whole && !best.empty() && number(*cell.mean, column.decimals) == best},
           {"gap", row.run && cell.count < cell.expected},
           {"mean", cell.mean ? PageJson(*cell.mean) : PageJson(nullptr)},
           {"deviation", cell.deviation ? PageJson(*cell.deviation) : PageJson(nullptr)},
           {"paper", figure ? PageJson(number(*figure, column.decimals)) : PageJson(nullptr)}});
    }
    rows.push_back({{"title", row.title + (row.run ? "" : " (quoted)")},
                    {"block", row.block},
                    {"cells", cells}});
  }
  return {{"title", title}, {"paper", papers}, {"rows", rows}};
}

PageJson tables_of(const Table& table) {
  PageJson tables = PageJson::array();
  if (!table.scenes.empty()) tables.push_back(table_entry(table, "", average_title(table)));
  for (const std::string& scene : table.scenes) {
    if (table.scenes.size() > 1) tables.push_back(table_entry(table, scene, scene));
  }
  for (const std::string& scene : quoted_scenes(table)) {
    tables.push_back(table_entry(table, scene, scene + " (quoted from the paper; not run here)"));
  }
  return tables;
}

PageJson columns_of(const Table& table) {
  PageJson columns = PageJson::array();
  for (const Column& column : table.columns) {
    const char* const arrow = column.better > 0 ? "\u00a0↑" : column.better < 0 ? "\u00a0↓" : "";
    columns.push_back({{"heading", column.heading + arrow},
                       {"meaning", column.meaning},
                       {"noise", column.noise}});
  }
  return columns;
}

}  // namespace

std::string to_page(const Table& table, const fs::path& folder) {
  PageJson facts = PageJson::array({table.steps + " steps"});
  for (const std::string& machine : table.machines) facts.push_back(machine);
  if (!table.paper_source.empty()) facts.push_back("paper: quoted, " + table.paper_source);
  PageJson rows = PageJson::array(), scenes = PageJson::array(), runs = PageJson::array();
  for (const TableRow& row : table.rows) {
    if (row.run) rows.push_back({{"name", row.name}, {"title", row.title}});
  }
  for (const std::string& scene : table.scenes) {
    scenes.push_back(scene_entry(table, scene, folder));
  }
  for (const RunRow& run : table.runs) runs.push_back(run_entry(run, RunFiles(folder, run)));
  const PageJson data{{"title", table.title.empty() ? table.name : table.title},
                      {"note", table.note},
                      {"facts", facts},
                      {"finished", finished(table)},
                      {"runs_total", table.runs.size()},
                      {"columns", columns_of(table)},
                      {"tables", tables_of(table)},
                      {"rows", rows},
                      {"scenes", scenes},
                      {"runs", runs},
                      {"remarks", table.remarks}};
  return page::sweep_page(data.dump(-1, ' ', false, PageJson::error_handler_t::replace));
}

}  // namespace jade::sweep
