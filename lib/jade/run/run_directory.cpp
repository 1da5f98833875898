// SPDX-License-Identifier: Apache-2.0
#include "jade/run/run_directory.h"

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/run/checkpoint.h"

namespace jade::run {

namespace fs = std::filesystem;

RunDirectory::RunDirectory(fs::path path) : path_(std::move(path)) {
  make_writable_folder(path_);
  lock_ = FolderLock::take(path_);
  if (!lock_) {
    throw DataError(
        concat(path_.string(),
               ": another process is training here; wait for it or choose another --output"));
  }
}

bool RunDirectory::holds_a_run() const {
  return !list_checkpoints(path_).empty() || fs::exists(path_ / "metrics.jsonl") ||
         fs::exists(path_ / kSceneFile);
}

bool RunDirectory::holds_results() const {
  return fs::exists(path_ / kSceneFile) || fs::exists(path_ / kScoresFile);
}

void RunDirectory::remove_results() const {
  for (const char* left : {kSceneFile, kCamerasFile, kScoresFile, kReportFile}) {
    fs::remove(path_ / left);
  }
}

}  // namespace jade::run
