// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <utility>

#include "jade/core/folder_lock.h"

namespace jade::run {

/// Files that the end of a run leaves in its folder: the scene, which marks the end, its learned
/// cameras, scores and report.
constexpr char kSceneFile[] = "point_cloud.ply";
constexpr char kLearnedCamerasFile[] = "cameras.json";
constexpr char kScoresFile[] = "eval.json";
constexpr char kReportFile[] = "report.html";

/// The folder of one run, held by one process at a time. Its contents: README.md.
class RunDirectory {
 public:
  /// Makes the folder and locks it.
  /// @throws DataError if it cannot be written, or another process trains in it.
  explicit RunDirectory(std::filesystem::path path);

  const std::filesystem::path& path() const { return path_; }

  /// True when a run has left something here that a new one would mix with.
  bool holds_a_run() const;

  /// True when a run has ended here: its scene or its scores are there.
  bool holds_results() const;

  /// Removes what an earlier end left, which is not of the scene as the run goes on.
  void remove_results() const;

 private:
  std::filesystem::path path_;
  std::optional<FolderLock> lock_;
};

/// metrics.jsonl: one JSON object a line.
class MetricsLog {
 public:
  /// Goes on with the file, dropping lines of steps after `step` (a killed run wrote them).
  MetricsLog(std::filesystem::path path, int64_t step);
  void append(const std::string& json_object);
  /// "seconds" of the last line that was kept; 0 without one.
  double seconds_before() const { return seconds_before_; }
  /// Also calls `listener` with each line from now on.
  void tell(std::function<void(const std::string&)> listener) { listener_ = std::move(listener); }

 private:
  std::filesystem::path path_;
  double seconds_before_ = 0;
  std::function<void(const std::string&)> listener_;
};

}  // namespace jade::run
