// SPDX-License-Identifier: Apache-2.0
// Collects the measurements of runs into the cells of a table.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "jade/core/error.h"
#include "jade/sweep/output.h"
#include "jade/sweep/plan.h"

namespace jade::sweep {

/// Column values of a run; unavailable ones are absent.
using Measured = std::map<std::string, double>;

/// Reads eval.json, metrics.jsonl, allocation.json and the outcome of a finished run.
Measured measure(const SweepOutput& output, const Run& run, const std::vector<Column>& columns);

/// A mean over seeds, of `count` out of `expected` values; notes below the table explain missing
/// ones.
struct Cell {
  std::optional<double> mean;
  std::optional<double> deviation;  ///< sample deviation; no value for fewer than two values
  int count = 0, expected = 0;
};

/// The cell of a list with missing values.
Cell cell_of(const std::vector<std::optional<double>>& values);

struct TableRow {
  std::string name, title, block;
  bool run = true;
  std::map<std::string, std::map<std::string, Cell>> scenes;  ///< scene, column
  /// Each seed's mean over the scenes, then mean and deviation over the seeds; only seeds with a
  /// value for every scene count.
  std::map<std::string, Cell> average;
  Figures paper;
  std::map<std::string, Figures> paper_scenes;
};

/// State of one run, for runs.csv and the list of unfinished runs.
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
  std::vector<std::string> remarks;   ///< notes for the reader: missing values, unknown runs,
                                      ///< skipped runs
  std::vector<std::string> machines;  ///< programs, devices and hosts of the runs
  std::string steps;                  ///< all values of train.iterations
};

/// Reads every run of the plan. `remarks` lists all that is missing.
Table gather(const Plan& plan, const SweepOutput& output);

std::string to_markdown(const Table& table);
/// row,title,scene,column,mean,deviation,count,expected,paper; scene "average" for the averages.
std::string to_csv(const Table& table);
/// row,scene,seed,state,reason and one column per measurement.
std::string runs_csv(const Table& table);
/// A booktabs table of the averages.
std::string to_latex(const Table& table);

/// A page with the tables, the state of every run, and their pictures side by side; links to
/// pictures and reports below runs/ in `folder`.
std::string to_page(const Table& table, const std::filesystem::path& folder);

/// State of a sweep as a whole.
struct Standing {
  size_t runs = 0, finished = 0, failed = 0, unfinished = 0;
  ExitCode code = ExitCode::kOk;  ///< of the first failed run, else kDevice if one was killed
};
Standing standing_of(const Table& table, const SweepOutput& output);

/// Writes table.md, table.csv, table.tex, runs.csv and index.html into the sweep's folder.
void write_table(const Table& table, const std::filesystem::path& folder);

}  // namespace jade::sweep
