// SPDX-License-Identifier: Apache-2.0
#include "jade/sweep/output.h"

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/folder_lock.h"

namespace jade::sweep {
namespace {

namespace fs = std::filesystem;

/// "key: saved -> now" of every setting that differs.
std::vector<std::string> differences(const Resolved& saved, const Resolved& now) {
  std::map<std::string, std::string> old(saved.values.begin(), saved.values.end());
  std::vector<std::string> lines;
  for (const auto& [key, value] : now.values) {
    const auto found = old.find(key);
    const std::string before = found == old.end() ? "(nothing)" : found->second;
    // The device does not change the result of a run.
    if (before != value && key != "device")
      lines.push_back(concat(key, ": ", before, " -> ", value));
  }
  return lines;
}

}  // namespace

std::string to_string(RunState state) {
  switch (state) {
    case RunState::kNew:
      return "new";
    case RunState::kUnfinished:
      return "unfinished";
    case RunState::kRunning:
      return "running";
    case RunState::kFinished:
      return "finished";
    case RunState::kFailed:
      return "failed";
  }
  return "";
}

void SweepOutput::check_settings(const Plan& plan, const Resolver& resolve, bool starts) const {
  std::string problems;
  for (const Run& run : plan.runs) {
    const bool may_differ = starts ? begins_afresh(run.id()) : state(run.id()) == RunState::kNew;
    if (may_differ || !fs::exists(settings_file(run.id()))) continue;
    const Resolved saved = resolve({{settings_file(run.id()), {}, {}}});
    if (!saved.conflict.empty()) throw ConfigError(saved.conflict);
    std::string keys;
    for (const std::string& line : differences(saved, run.settings))
      keys += (keys.empty() ? "" : "; ") + line;
    if (!keys.empty()) problems += concat(problems.empty() ? "" : "\n", run.id(), ": ", keys);
  }
  if (!problems.empty()) {
    throw ConfigError(
        concat(folder_.string(),
               ": these runs were started with other settings, and one table must not mix "
               "them; put the settings back or choose another --output:\n",
               problems));
  }
}

void SweepOutput::write_settings(const Plan& plan, const Resolver& resolve) const {
  check_settings(plan, resolve);
  for (const Run& run : plan.runs) {
    const fs::path file = settings_file(run.id());
    make_writable_folder(file.parent_path());
    // A failure under other settings says nothing about these.
    if (begins_afresh(run.id()) && fs::exists(file) && read_file(file) != run.settings.yaml)
      fs::remove(outcome_file(run.id()));
    write_file(file, run.settings.yaml);
  }
}

RunState SweepOutput::state(const std::string& id) const {
  const fs::path run = run_folder(id);
  if (FolderLock::is_held(run)) return RunState::kRunning;
  const Outcome last = outcome(id);
  // Without test views there is no eval.json, so use the exit code.
  if (fs::exists(run / "point_cloud.ply") &&
      (fs::exists(run / "eval.json") || last.exit_code == 0)) {
    return RunState::kFinished;
  }
  if (last.attempts == 0 && !fs::exists(run)) return RunState::kNew;
  const bool stopped = last.exit_code < 0 || last.exit_code == 0 ||
                       last.exit_code == static_cast<int>(ExitCode::kInterrupted);
  return stopped ? RunState::kUnfinished : RunState::kFailed;
}

Outcome SweepOutput::outcome(const std::string& id) const {
  Outcome outcome;
  if (!fs::exists(outcome_file(id))) return outcome;
  const auto json = nlohmann::json::parse(read_file(outcome_file(id)), nullptr, false);
  if (!json.is_object()) throw DataError(concat(outcome_file(id).string(), ": damaged; remove it"));
  outcome.attempts = json.value("attempts", 0);
  outcome.exit_code = json.value("exit_code", -1);
  outcome.signal = json.value("signal", 0);
  outcome.seconds = json.value("seconds", 0.0);
  outcome.peak_host_bytes = json.value("peak_host_bytes", int64_t{0});
  outcome.peak_device_bytes = json.value("peak_device_bytes", int64_t{0});
  outcome.device = json.value("device", "");
  outcome.host = json.value("host", "");
  outcome.reason = json.value("reason", "");
  return outcome;
}

void SweepOutput::write_outcome(const std::string& id, const Outcome& outcome) const {
  make_writable_folder(outcome_file(id).parent_path());
  const nlohmann::ordered_json json{{"attempts", outcome.attempts},
                                    {"exit_code", outcome.exit_code},
                                    {"signal", outcome.signal},
                                    {"seconds", outcome.seconds},
                                    {"peak_host_bytes", outcome.peak_host_bytes},
                                    {"peak_device_bytes", outcome.peak_device_bytes},
                                    {"device", outcome.device},
                                    {"host", outcome.host},
                                    {"reason", outcome.reason}};
  // A log may contain bytes that are not UTF-8.
  write_file(outcome_file(id),
             json.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n");
}

std::vector<std::string> SweepOutput::present() const {
  std::vector<std::string> ids;
  std::error_code none;
  const fs::path root = folder_ / "runs";
  for (const auto& row : fs::directory_iterator(root, none)) {
    for (const auto& scene : fs::directory_iterator(row.path(), none)) {
      for (const auto& seed : fs::directory_iterator(scene.path(), none)) {
        ids.push_back(fs::relative(seed.path(), root).string());
      }
    }
  }
  std::sort(ids.begin(), ids.end());
  return ids;
}

bool SweepOutput::can_resume(const std::string& id) const {
  std::error_code none;
  for (const auto& entry : fs::directory_iterator(run_folder(id) / "checkpoints", none)) {
    if (entry.path().extension() == ".pt") return true;
  }
  return false;
}

bool SweepOutput::begins_afresh(const std::string& id) const {
  const RunState now = state(id);
  return now == RunState::kNew || (now == RunState::kFailed && !can_resume(id));
}

}  // namespace jade::sweep
