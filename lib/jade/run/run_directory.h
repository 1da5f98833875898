// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>

#include "jade/core/folder_lock.h"

namespace jade::run {

/// Files that the end of a run writes: the scene, which marks the end, its learned cameras, scores
/// and report.
constexpr char kSceneFile[] = "point_cloud.ply";
constexpr char kCamerasFile[] = "cameras.json";
constexpr char kScoresFile[] = "eval.json";
constexpr char kReportFile[] = "report.html";

/// File about the machine and the data, written at the start, and its list of the frames that the
/// run trains on: objects with "name" and "sha256" (data::TrainedFrame).
constexpr char kEnvironmentFile[] = "env.json";
constexpr char kTrainedKey[] = "trained_on";
/// Its list of the test views, which a run with learned poses fits at its end; as kTrainedKey.
constexpr char kTestKey[] = "test_views";

/// The folder of one run, locked by one process at a time. README.md lists its contents.
class RunDirectory {
 public:
  /// Creates the folder and locks it.
  /// @throws DataError if it cannot be written, or another process trains in it.
  explicit RunDirectory(std::filesystem::path path);

  const std::filesystem::path& path() const { return path_; }

  /// True if the folder contains files of a run with which a new run would conflict.
  bool holds_a_run() const;

  /// True if a run has ended here: its scene or its scores exist.
  bool holds_results() const;

  /// Renames the results of an earlier end, which a resumed run replaces: left_point_cloud.ply.
  /// @return false if there are none
  bool set_aside_results() const;
  /// Removes what set_aside_results() renamed.
  void remove_left_results() const;

 private:
  std::filesystem::path path_;
  std::optional<FolderLock> lock_;
};

}  // namespace jade::run
