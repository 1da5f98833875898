// SPDX-License-Identifier: Apache-2.0
#include "jade/sweep/task.h"

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>
#include <unistd.h>

#include "jade/core/interrupt.h"
#include "jade/core/log.h"

namespace jade::sweep {
namespace {

namespace fs = std::filesystem;

constexpr int kDiverged = static_cast<int>(ExitCode::kNumeric);

/// The end of a file, at most `bytes` of it and nothing before `begin`.
std::string tail(const fs::path& path, int64_t begin, int64_t bytes) {
  std::ifstream in(path, std::ios::binary | std::ios::ate);
  if (!in) return "";
  const int64_t size = in.tellg();
  in.seekg(std::min(size, std::max(begin, size - bytes)));
  return {std::istreambuf_iterator<char>(in), {}};
}

/// The last line with content, errors first. Attempts share a log; this one's begins at byte
/// `begin`.
std::string last_words(const fs::path& log, int64_t begin) {
  std::istringstream in(tail(log, begin, 8192));
  std::string last, error;
  for (std::string line; std::getline(in, line);) {
    if (!line.empty()) last = line;
    if (line.rfind("error: ", 0) == 0) error = line.substr(7);
  }
  return error.empty() ? last : error;
}

std::vector<std::string> command_of(const SweepOutput& output, const std::string& id,
                                    const TaskOptions& options, bool resume) {
  std::vector<std::string> command{options.program.string(),
                                   "--config",
                                   output.settings_file(id).string(),
                                   "--output",
                                   output.run_folder(id).string(),
                                   "--device",
                                   options.device};
  if (resume) command.push_back("--resume");
  return command;
}

int64_t size_of(const fs::path& file) {
  std::error_code none;
  const auto size = fs::file_size(file, none);
  return none ? 0 : static_cast<int64_t>(size);
}

/// Whether the next attempt continues the last one.
bool resumes(const SweepOutput& output, const std::string& id) {
  return output.outcome(id).exit_code != kDiverged && output.can_resume(id);
}

Child start(const SweepOutput& output, const std::string& id, const TaskOptions& options) {
  const bool resume = resumes(output, id);
  if (!resume) fs::remove_all(output.run_folder(id));
  fs::create_directories(output.run_folder(id));
  std::vector<std::pair<std::string, std::string>> environment;
  if (options.threads > 0) environment.emplace_back("OMP_NUM_THREADS", concat(options.threads));
  // Runs on GPUs need the CPU only briefly per step. Threads that spin in between would slow down
  // the other runs.
  if (options.device.rfind("cuda", 0) == 0 && std::getenv("OMP_WAIT_POLICY") == nullptr) {
    environment.emplace_back("OMP_WAIT_POLICY", "passive");
  }
  return {command_of(output, id, options, resume), environment, output.log_file(id)};
}

Outcome begun(const SweepOutput& output, const std::string& id, const TaskOptions& options) {
  Outcome outcome = output.outcome(id);
  char host[256] = "";
  gethostname(host, sizeof host - 1);
  ++outcome.attempts;
  if (!resumes(output, id)) outcome.seconds = 0;
  outcome.exit_code = -1;
  outcome.signal = 0;
  outcome.device = options.device;
  outcome.host = host;
  outcome.reason.clear();
  return outcome;
}

}  // namespace

bool wants_attempt(const SweepOutput& output, const std::string& id, bool retry_failed) {
  const RunState state = output.state(id);
  if (state == RunState::kNew || state == RunState::kUnfinished) return true;
  return state == RunState::kFailed && (retry_failed || output.outcome(id).exit_code != kDiverged);
}

Task::Task(const SweepOutput& output, std::string id, const TaskOptions& options)
    : output_(output),
      id_(std::move(id)),
      outcome_(begun(output, id_, options)),
      log_begin_(size_of(output.log_file(id_))),
      start_(std::chrono::steady_clock::now()),
      child_(start(output, id_, options)) {
  // Written before the run ends: if this process is killed, the attempt still counts.
  output_.write_outcome(id_, outcome_);
}

std::optional<Outcome> Task::poll() {
  const auto exit = child_.poll();
  if (!exit) return std::nullopt;
  outcome_.exit_code = exit->code;
  outcome_.signal = exit->signal;
  outcome_.seconds +=
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  outcome_.peak_host_bytes = std::max(outcome_.peak_host_bytes, exit->peak_bytes);
  if (outcome_.exit_code == 127) outcome_.reason = "the training program could not be started";
  if (outcome_.exit_code != 0 && outcome_.reason.empty()) {
    outcome_.reason = last_words(output_.log_file(id_), log_begin_);
  }
  output_.write_outcome(id_, outcome_);
  return outcome_;
}

void Task::note_device_peak(int64_t bytes) {
  outcome_.peak_device_bytes = std::max(outcome_.peak_device_bytes, bytes);
}

int64_t Task::step() const {
  std::istringstream in(tail(output_.run_folder(id_) / "metrics.jsonl", 0, 4096));
  int64_t step = 0;
  for (std::string line; std::getline(in, line);) {
    const auto json = nlohmann::json::parse(line, nullptr, /*allow_exceptions=*/false);
    if (json.is_object()) step = json.value("step", step);
  }
  return step;
}

ExitCode run_task(const SweepOutput& output, const std::string& id, const TaskOptions& options) {
  if (!fs::exists(output.settings_file(id))) {
    throw ConfigError(concat("--run-task ", id, ": expected a run of ", output.folder().string(),
                             ", found none of that name"));
  }
  const RunState state = output.state(id);
  if (state == RunState::kRunning) {
    throw DataError(concat(id, ": another process trains it now"));
  }
  if (!wants_attempt(output, id, options.retry_failed)) {
    log_info(concat(id, ": ", to_string(state), " already"));
    return state == RunState::kFinished ? ExitCode::kOk : ExitCode::kNumeric;
  }
  Task task(output, id, options);
  for (bool told = false;;) {
    if (const auto outcome = task.poll()) {
      log_info(concat(id, ": ", describe(*outcome)));
      return outcome->exit_code >= 0 ? static_cast<ExitCode>(outcome->exit_code)
                                     : ExitCode::kDevice;
    }
    if (interrupt_requested() && !told) {
      task.interrupt();
      told = true;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
}

std::string describe(const Outcome& outcome) {
  if (outcome.exit_code == 0) return "done";
  std::string what = concat("exit ", outcome.exit_code);
  if (outcome.exit_code == kDiverged) what = "diverged (exit 5)";
  if (outcome.exit_code == static_cast<int>(ExitCode::kInterrupted)) what = "interrupted";
  if (outcome.signal != 0) what = concat("killed by signal ", outcome.signal);
  if (outcome.exit_code < 0 && outcome.signal == 0) what = "did not end";
  return outcome.reason.empty() ? what : what + ": " + outcome.reason;
}

}  // namespace jade::sweep
