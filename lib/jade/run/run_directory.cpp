// SPDX-License-Identifier: Apache-2.0
#include "jade/run/run_directory.h"

#include <array>
#include <string>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/run/checkpoint.h"

namespace jade::run {

namespace fs = std::filesystem;

namespace {

constexpr std::array kResults = {kSceneFile, kCamerasFile, kScoresFile, kReportFile};

std::string left_name(const char* file) { return std::string("left_") + file; }

}  // namespace

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

bool RunDirectory::set_aside_results() const {
  bool any = false;
  for (const char* file : kResults) {
    if (!fs::exists(path_ / file)) continue;
    fs::rename(path_ / file, path_ / left_name(file));
    any = true;
  }
  return any;
}

void RunDirectory::remove_left_results() const {
  for (const char* file : kResults) fs::remove(path_ / left_name(file));
}

}  // namespace jade::run
