// SPDX-License-Identifier: Apache-2.0
// Contents of a sweep's YAML file. docs/sweeps.md describes every key.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <tuple>
#include <vector>

namespace jade::sweep {

inline constexpr int kMostJobs = 100000;

/// A column of the result table.
struct Column {
  std::string key;      ///< "psnr_channel_mean", "ssim@20000", "minutes", …
  std::string heading;  ///< for people
  std::string meaning;  ///< one line below the table
  int decimals = 3;
  int better = 0;  ///< +1: more is better, -1: less is better, 0: neither
  /// Difference between two runs that the seed alone explains: three sample deviations, the median
  /// of the rows in docs/results that have several seeds. 0: unknown.
  double noise = 0;
};

/// A base configuration with its data.
struct Scene {
  std::string name;
  std::filesystem::path config;
  std::vector<std::string> set;  ///< "key=value" overrides
  std::string make;              ///< how to get the data, for the message if it is missing
  std::vector<std::string> set_places = {};  ///< "FILE:LINE:COLUMN: " of each override
};

/// Numbers of the paper, by column.
using Figures = std::map<std::string, double>;

/// One line of the table: overrides for every scene, or quoted figures only.
struct Row {
  std::string name, title, block;
  std::vector<std::filesystem::path> configs;
  std::vector<std::string> set;
  std::vector<int64_t> seeds;  ///< empty: the sweep's
  bool run = true;             ///< false: a quoted row, without runs
  Figures paper;               ///< its average
  std::map<std::string, Figures> paper_scenes;
  std::vector<std::string> set_places = {};  ///< "FILE:LINE:COLUMN: " of each override
};

struct Spec {
  std::string name;  ///< of the file
  std::string title, note, paper_source;
  std::vector<Column> columns;
  std::vector<int64_t> seeds{0};
  int jobs = 0;  ///< at most kMostJobs; 0: jobs_for() decides
  std::vector<std::string> set;
  std::vector<Scene> scenes;
  std::vector<Row> rows;
  std::vector<std::string> set_places = {};  ///< "FILE:LINE:COLUMN: " of each override
};

/// Reads a sweep file after the files that its `extends` names; the last value of each key wins,
/// for whole lists too. Relative paths are resolved against the folder of their file.
/// @throws ConfigError with all problems, one per line, unknown words with the nearest known one.
Spec read_spec(const std::filesystem::path& file);

/// When runs evaluate: every so many steps, and at the end.
struct Schedule {
  int64_t iterations = 0;
  int64_t evaluate_every = 0;  ///< 0: only at the end
  bool operator<(const Schedule& other) const {
    return std::tie(iterations, evaluate_every) < std::tie(other.iterations, other.evaluate_every);
  }
};

/// Why no run fills a column KEY@STEP, and what to do; empty if one does, or if the column has no
/// step.
std::string empty_column(const Column& column, const std::set<Schedule>& schedules);

/// The column of that key. @throws ConfigError naming the nearest.
Column column_of(const std::string& key);

}  // namespace jade::sweep
