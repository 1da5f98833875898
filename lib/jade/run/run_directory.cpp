// SPDX-License-Identifier: Apache-2.0
#include "jade/run/run_directory.h"

#include <fstream>
#include <nlohmann/json.hpp>

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
  for (const char* left : {kSceneFile, kLearnedCamerasFile, kScoresFile, kReportFile}) {
    fs::remove(path_ / left);
  }
}

MetricsLog::MetricsLog(fs::path path, int64_t step) : path_(std::move(path)) {
  std::string kept;
  std::ifstream old(path_);
  for (std::string line; std::getline(old, line);) {
    const auto object = nlohmann::json::parse(line, nullptr, /*allow_exceptions=*/false);
    // A killed run may leave an incomplete line, which is not valid JSON.
    if (!object.is_object() || object.value("step", int64_t{0}) > step) continue;
    kept += line + "\n";
    seconds_before_ = object.value("seconds", seconds_before_);
  }
  write_file(path_, kept);
}

void MetricsLog::append(const std::string& json_object) {
  std::ofstream out(path_, std::ios::app);
  out << json_object << '\n';
  out.close();
  if (!out) throw DataError(concat(path_.string(), ": cannot be written; is the disk full?"));
  if (listener_) listener_(json_object);
}

}  // namespace jade::run
