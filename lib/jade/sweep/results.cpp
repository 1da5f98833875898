// SPDX-License-Identifier: Apache-2.0
#include "jade/sweep/results.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/readable.h"
#include "jade/core/text.h"
#include "jade/sweep/task.h"

namespace jade::sweep {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

/// The JSON object in the file, or an empty one without a file.
Json object_of(const fs::path& path) {
  if (!fs::exists(path)) return Json::object();
  Json json = Json::parse(read_file(path), nullptr, /*allow_exceptions=*/false);
  if (!json.is_object())
    throw DataError(concat(path.string(), ": expected a JSON object, found a damaged file; remove ",
                           path.parent_path().string(), " and call jade_sweep again, which trains ",
                           "this run again, or remove the file to do without its numbers"));
  return json;
}

void take_numbers(const Json& object, Measured& measured, const std::string& ending = "") {
  for (const auto& [key, value] : object.items()) {
    if (value.is_number()) measured[key + ending] = value.get<double>();
  }
}

/// The means over all, seen and unseen test views; files of older programs have only the first.
void read_scores(const fs::path& path, Measured& measured) {
  const Json json = object_of(path);
  for (const char* ending : {"", "_seen", "_unseen"}) {
    take_numbers(json.value(concat("mean", ending), Json::object()), measured, ending);
  }
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const size_t half = values.size() / 2;
  return values.size() % 2 ? values[half] : 0.5 * (values[half - 1] + values[half]);
}

/// Throughput, memory, Gaussians, and the intermediate metrics as "ssim@20000".
void read_metrics(const fs::path& path, Measured& measured) {
  std::vector<double> rates;
  std::ifstream in(path);
  for (std::string line; std::getline(in, line);) {
    const Json json = Json::parse(line, nullptr, /*allow_exceptions=*/false);
    if (!json.is_object()) continue;
    const std::string step = concat("@", json.value("step", int64_t{0}));
    for (const auto& [key, value] : json.items()) {
      if (!value.is_number()) continue;
      if (key.rfind("test_", 0) == 0) measured[key.substr(5) + step] = value.get<double>();
      if (key == "iterations_per_second") rates.push_back(value.get<double>());
      if (key == "gaussians") measured["gaussians"] = value.get<double>();
      if (key == "memory_bytes") {
        double& most = measured["memory_gib"];
        most = std::max(most, value.get<double>() / (1 << 30));
      }
    }
  }
  if (!rates.empty()) measured["iterations_per_second"] = median(rates);
}

/// The last step's metrics are in eval.json; repeat them under "@iterations".
void repeat_at_end(const Run& run, Measured& measured) {
  const std::string step = "@" + run.value("train.iterations");
  Measured more;
  for (const auto& [key, value] : measured) {
    if (key.find('@') == std::string::npos) more[key + step] = value;
  }
  measured.insert(more.begin(), more.end());
}

std::vector<std::optional<double>> values_of(const std::vector<const RunRow*>& runs,
                                             const std::string& column) {
  std::vector<std::optional<double>> values;
  for (const RunRow* run : runs) {
    const auto found = run->measured.find(column);
    values.push_back(found == run->measured.end() ? std::nullopt
                                                  : std::optional<double>(found->second));
  }
  return values;
}

/// The mean over the scenes; no value if any scene lacks it.
std::optional<double> complete_mean(const std::vector<std::optional<double>>& values,
                                    size_t scenes) {
  double sum = 0;
  for (const auto& value : values) {
    if (!value) return std::nullopt;
    sum += *value;
  }
  if (values.size() != scenes || values.empty()) return std::nullopt;
  return sum / static_cast<double>(values.size());
}

TableRow table_row(const Row& row, const Table& table) {
  TableRow out{row.name, row.title, row.block, row.run, {}, {}, row.paper, row.paper_scenes};
  std::map<int64_t, std::vector<const RunRow*>> by_seed;
  std::map<std::string, std::vector<const RunRow*>> by_scene;
  for (const RunRow& run : table.runs) {
    if (run.row != row.name) continue;
    by_seed[run.seed].push_back(&run);
    by_scene[run.scene].push_back(&run);
  }
  for (const Column& column : table.columns) {
    for (const auto& [scene, runs] : by_scene) {
      out.scenes[scene][column.key] = cell_of(values_of(runs, column.key));
    }
    std::vector<std::optional<double>> means;
    for (const auto& [seed, runs] : by_seed) {
      means.push_back(complete_mean(values_of(runs, column.key), table.scenes.size()));
    }
    out.average[column.key] = cell_of(means);
  }
  return out;
}

void remark_gaps(Table& table) {
  for (const RunRow& run : table.runs) {
    if (run.state == RunState::kFinished) continue;
    table.remarks.push_back(concat(Run::concat_id(run.row, run.scene, run.seed), ": ",
                                   to_string(run.state), run.word.empty() ? "" : ": " + run.word));
  }
  for (const Column& column : table.columns) {
    std::vector<std::string> lacking;
    size_t finished = 0;
    for (const RunRow& run : table.runs) {
      if (run.state != RunState::kFinished) continue;
      ++finished;
      if (!run.measured.count(column.key))
        lacking.push_back(Run::concat_id(run.row, run.scene, run.seed));
    }
    if (lacking.empty()) continue;
    table.remarks.push_back(concat(
        column.key, ": not measured by ",
        lacking.size() == finished ? "all finished runs" : listing(lacking, lacking.size())));
  }
}

void gather_machines(const Plan& plan, const SweepOutput& output, Table& table) {
  std::set<std::string> machines;
  for (const Run& run : plan.runs) {
    const Json json = object_of(output.run_folder(run.id()) / "env.json");
    if (json.empty()) continue;
    machines.insert(concat(json.value("program", "?"), " (commit ", json.value("commit", "?"),
                           ", torch ", json.value("torch", "?"), ") on ",
                           json.value("device", "?")));
  }
  table.machines.assign(machines.begin(), machines.end());
  std::set<int64_t> steps;
  for (const Run& run : plan.runs) steps.insert(std::stoll(run.value("train.iterations")));
  for (const int64_t count : steps) {
    table.steps += (table.steps.empty() ? "" : ", ") + grouped(count);
  }
}

/// One line for runs of the folder that the flags leave out, and one for those of other sweeps.
void remark_others(const Plan& plan, const SweepOutput& output, Table& table) {
  std::set<std::string> known;
  for (const Run& run : plan.runs) known.insert(run.id());
  std::vector<std::string> left_out, strangers;
  for (const std::string& id : output.present()) {
    if (!known.count(id)) (plan.whole.count(id) ? left_out : strangers).push_back(id);
  }
  if (!left_out.empty()) {
    table.remarks.push_back(concat(
        "not in the table, because --rows, --scenes, --seeds or --skip-missing leave them out: ",
        listing(left_out, 5), "; --table without these flags writes the whole table"));
  }
  if (strangers.empty()) return;
  table.remarks.push_back(
      concat("not in the table, because they are no part of this sweep, though in its folder: ",
             listing(strangers, 5)));
}

}  // namespace

Measured measure(const SweepOutput& output, const Run& run, const std::vector<Column>& columns) {
  const fs::path folder = output.run_folder(run.id());
  Measured all;
  read_metrics(folder / "metrics.jsonl", all);
  read_scores(folder / "eval.json", all);
  take_numbers(object_of(folder / "allocation.json").value("mean", Json::object()), all);
  const double seconds = output.outcome(run.id()).seconds;
  if (seconds > 0) {
    all["minutes"] = seconds / 60;
    all["hours"] = seconds / 3600;
  }
  repeat_at_end(run, all);
  Measured asked;
  for (const Column& column : columns) {
    const auto found = all.find(column.key);
    if (found != all.end()) asked[column.key] = found->second;
  }
  return asked;
}

Cell cell_of(const std::vector<std::optional<double>>& values) {
  Cell cell;
  cell.expected = static_cast<int>(values.size());
  double sum = 0;
  for (const auto& value : values) {
    if (!value) continue;
    sum += *value;
    ++cell.count;
  }
  if (cell.count == 0) return cell;
  cell.mean = sum / cell.count;
  if (cell.count < 2) return cell;
  double squares = 0;
  for (const auto& value : values) {
    if (value) squares += (*value - *cell.mean) * (*value - *cell.mean);
  }
  cell.deviation = std::sqrt(squares / (cell.count - 1));
  return cell;
}

Table gather(const Plan& plan, const SweepOutput& output) {
  Table table{plan.spec.name,
              plan.spec.title,
              plan.spec.note,
              plan.spec.paper_source,
              plan.spec.columns,
              {},
              {},
              {},
              {},
              {},
              ""};
  for (const Scene& scene : plan.spec.scenes) {
    const bool runs = std::any_of(plan.runs.begin(), plan.runs.end(),
                                  [&](const Run& run) { return run.scene == scene.name; });
    if (runs) table.scenes.push_back(scene.name);
  }
  for (const Run& run : plan.runs) {
    const std::string id = run.id();
    RunRow row{run.row, run.scene, run.seed, output.state(id), "", {}};
    const Outcome outcome = output.outcome(id);
    if (row.state == RunState::kFinished) {
      row.measured = measure(output, run, plan.spec.columns);
    } else if (outcome.attempts > 0 && row.state != RunState::kRunning) {
      row.word = describe(outcome);
    }
    table.runs.push_back(std::move(row));
  }
  for (const Row& row : plan.spec.rows) table.rows.push_back(table_row(row, table));
  remark_gaps(table);
  for (const std::string& skipped : plan.skipped)
    table.remarks.push_back(skipped + " (not run: --skip-missing)");
  remark_others(plan, output, table);
  gather_machines(plan, output, table);
  return table;
}

Standing standing_of(const Table& table, const SweepOutput& output) {
  Standing standing;
  bool killed = false;
  standing.runs = table.runs.size();
  for (const RunRow& run : table.runs) {
    standing.finished += run.state == RunState::kFinished;
    const Outcome outcome = output.outcome(Run::concat_id(run.row, run.scene, run.seed));
    if (run.state == RunState::kFailed && ++standing.failed == 1) {
      standing.code = static_cast<ExitCode>(outcome.exit_code);
    }
    killed = killed || (run.state == RunState::kUnfinished && outcome.signal != 0);
  }
  // Usually killed by the kernel for lack of memory.
  if (killed && standing.failed == 0) standing.code = ExitCode::kDevice;
  standing.unfinished = standing.runs - standing.finished - standing.failed;
  return standing;
}

void write_table(const Table& table, const fs::path& folder) {
  write_file(folder / "table.md", to_markdown(table));
  write_file(folder / "table.csv", to_csv(table));
  write_file(folder / "table.tex", to_latex(table));
  write_file(folder / "runs.csv", runs_csv(table));
  write_file(folder / "index.html", to_page(table, folder));
}

}  // namespace jade::sweep
