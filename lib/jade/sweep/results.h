// SPDX-License-Identifier: Apache-2.0
// Gathers the measurements of runs into the cells of a table.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "jade/core/error.h"
#include "jade/sweep/output.h"
#include "jade/sweep/plan.h"

namespace jade::sweep {

/// The columns that a run can fill; one that it cannot is absent.
using Measured = std::map<std::string, double>;

/// From eval.json, metrics.jsonl, allocation.json and the outcome of a finished run.
Measured measure(const SweepOutput& output, const Run& run, const std::vector<Column>& columns);

/// A mean over seeds. `count` of `expected` values are in it; the rest is told below the table.
struct Cell {
  std::optional<double> mean;
  std::optional<double> deviation;  ///< sample deviation; absent for fewer than two values
  int count = 0, expected = 0;
};

/// The cell of a list with gaps.
Cell cell_of(const std::vector<std::optional<double>>& values);

struct TableRow {
  std::string name, title, block;
  bool run = true;
  std::map<std::string, std::map<std::string, Cell>> scenes;  ///< scene, column
  /// Each seed's mean over the scenes, then mean and deviation of these over the seeds; only seeds
  /// whose every scene has the value count.
  std::map<std::string, Cell> average;
  Figures paper;
  std::map<std::string, Figures> paper_scenes;
};

/// One run as it stands: for runs.csv and the list of what is not finished.
struct RunRow {
  std::string row, scene;
  int64_t seed = 0;
  RunState state = RunState::kNew;
  std::string word;  ///< why it is not finished
  Measured measured;
};

struct Table {
  std::string name, title, note, paper_source;
  std::vector<Column> columns;
  std::vector<std::string> scenes;
  std::vector<TableRow> rows;
  std::vector<RunRow> runs;
  std::vector<std::string> remarks;   ///< everything that a reader must know: gaps, strays, skips
  std::vector<std::string> machines;  ///< programs, devices and hosts that made the figures
  std::string steps;                  ///< train.iterations, all that occur
};

/// Reads every run of the plan. Nothing is dropped: what is missing is in `remarks`.
Table gather(const Plan& plan, const SweepOutput& output);

std::string to_markdown(const Table& table);
/// row,title,scene,column,mean,deviation,count,expected,paper; scene "average" for the averages.
std::string to_csv(const Table& table);
/// row,scene,seed,state,reason and one column a measurement.
std::string runs_csv(const Table& table);
/// A booktabs table of the averages.
std::string to_latex(const Table& table);

/// A page with the tables, how every run stands, and their pictures beside each other, which it
/// links from runs/ in `folder`, as it does the runs' reports.
std::string to_page(const Table& table, const std::filesystem::path& folder);

/// How a sweep stands as a whole.
struct Standing {
  size_t runs = 0, finished = 0, failed = 0, unfinished = 0;
  ExitCode code = ExitCode::kOk;  ///< of the first failed run, else kDevice where one was killed
};
Standing standing_of(const Table& table, const SweepOutput& output);

/// table.md, table.csv, table.tex, runs.csv and index.html in the sweep's folder.
void write_table(const Table& table, const std::filesystem::path& folder);

}  // namespace jade::sweep
