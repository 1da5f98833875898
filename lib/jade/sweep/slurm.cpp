// SPDX-License-Identifier: Apache-2.0
#include "jade/sweep/slurm.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <map>
#include <set>
#include <sstream>
#include <sys/wait.h>
#include <thread>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/core/progress.h"
#include "jade/sweep/task.h"

namespace jade::sweep {
namespace {

namespace fs = std::filesystem;

/// Quotes a shell word.
std::string quoted(const std::string& text) {
  std::string out = "'";
  for (const char c : text) out += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return out + "'";
}

struct Answer {
  int code;
  std::string text;
};

Answer ask(const std::string& command) {
  FILE* pipe = popen((command + " 2>&1").c_str(), "r");
  if (pipe == nullptr) throw DeviceError("cannot start a shell for " + command);
  std::string text;
  char buffer[4096];
  for (size_t count; (count = std::fread(buffer, 1, sizeof buffer, pipe)) > 0;)
    text.append(buffer, count);
  const int status = pclose(pipe);
  while (!text.empty() && text.back() == '\n') text.pop_back();
  return {WIFEXITED(status) ? WEXITSTATUS(status) : 128, text};
}

Answer ask_slurm(const std::string& command) {
  const Answer answer = ask(command);
  if (answer.code == 0) return answer;
  const std::string program = command.substr(0, command.find(' '));
  throw DeviceError(concat(program, ": ",
                           answer.code == 127 ? "Slurm is not installed here" : answer.text,
                           "; use --launcher local, or run this where sbatch works"));
}

/// jobs.txt: one line "JOB LIST" per submission; LIST names the runs by array index.
std::map<std::string, std::string> submissions(const fs::path& folder) {
  std::map<std::string, std::string> lists;
  std::ifstream in(folder / "jobs.txt");
  for (std::string job, list; in >> job >> list;) lists[job] = list;
  return lists;
}

std::vector<std::string> lines_of(const fs::path& path) {
  std::vector<std::string> lines;
  std::ifstream in(path);
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  return lines;
}

std::string script_of(const SweepOutput& output, const SlurmOptions& options, const fs::path& list,
                      size_t count) {
  std::string script =
      "#!/bin/bash\n#SBATCH --job-name=jade_sweep\n#SBATCH --requeue\n#SBATCH --open-mode=append\n";
  script += concat("#SBATCH --array=0-", count - 1,
                   options.jobs > 0 ? concat("%", options.jobs) : "", "\n");
  script += concat("#SBATCH --output=", (output.folder() / "slurm").string(), "/%A_%a.out\n");
  script += concat(
      "# Array index N runs line N + 1 of the list.\nrun=$(sed -n \"$((SLURM_ARRAY_TASK_ID + "
      "1))p\" ",
      quoted(list.string()), ")\n");
  script += "export OMP_NUM_THREADS=${SLURM_CPUS_PER_TASK:-${SLURM_CPUS_ON_NODE:-1}}\n";
  // exec, so that Slurm's signal to stop reaches the program, not a shell.
  script +=
      concat("exec ", quoted(options.self.string()), " --output ", quoted(output.folder().string()),
             " --run-task \"$run\" --devices ", quoted(options.device),
             options.program.empty()
                 ? ""
                 : " --train-program " + quoted(fs::absolute(options.program).string()),
             options.retry_failed ? " --retry-failed" : "", "\n");
  return script;
}

}  // namespace

std::set<std::string> queued_runs(const SweepOutput& output) {
  const fs::path folder = output.folder() / "slurm";
  const auto lists = submissions(folder);
  std::set<std::string> runs;
  if (lists.empty()) return runs;
  std::istringstream in(
      ask_slurm("squeue --noheader --array --states=all --format='%F %K %T'").text);
  for (std::string job, index, state; in >> job >> index >> state;) {
    static const std::set<std::string> alive = {"PENDING",     "RUNNING",     "SUSPENDED",
                                                "REQUEUED",    "CONFIGURING", "REQUEUE_HOLD",
                                                "REQUEUE_FED", "RESIZING",    "STOPPED"};
    const auto list = lists.find(job);
    if (list == lists.end() || !alive.count(state)) continue;
    const auto ids = lines_of(folder / list->second);
    const size_t place = index.find_first_not_of("0123456789") == std::string::npos
                             ? static_cast<size_t>(std::stoull(index))
                             : ids.size();
    if (place < ids.size()) runs.insert(ids[place]);
  }
  return runs;
}

Submission submit(const Plan& plan, const SweepOutput& output, const SlurmOptions& options) {
  const fs::path folder = output.folder() / "slurm";
  make_writable_folder(folder);
  const std::set<std::string> queued = queued_runs(output);
  Submission submission;
  std::string list;
  for (const Run& run : plan.runs) {
    const std::string id = run.id();
    if (queued.count(id)) {
      ++submission.queued;
    } else if (wants_attempt(output, id, options.retry_failed)) {
      list += id + "\n";
      ++submission.submitted;
    }
  }
  if (submission.submitted == 0) return submission;
  const size_t number = submissions(folder).size() + 1;
  const fs::path list_file = folder / concat("list_", number, ".txt");
  const fs::path script = folder / concat("array_", number, ".sh");
  write_file(list_file, list);
  write_file(script,
             script_of(output, options, list_file, static_cast<size_t>(submission.submitted)));
  std::string command = "sbatch --parsable";
  for (const std::string& argument : options.arguments) command += " " + quoted(argument);
  const Answer answer = ask_slurm(command + " " + quoted(script.string()));
  submission.job = answer.text.substr(0, answer.text.find_first_of(";\n"));
  if (submission.job.empty() ||
      submission.job.find_first_not_of("0123456789") != std::string::npos) {
    throw DeviceError(
        concat("sbatch: ", answer.text, "; use --launcher local, or run this where sbatch works"));
  }
  std::ofstream(folder / "jobs.txt", std::ios::app)
      << submission.job << ' ' << list_file.filename().string() << '\n';
  return submission;
}

void wait_for_slurm(const Plan& plan, const SweepOutput& output) {
  const auto total = static_cast<int64_t>(plan.runs.size());
  Progress progress("slurm", total, 0, "runs");
  for (int64_t done = 0;;) {
    const auto left = static_cast<int64_t>(queued_runs(output).size());
    const int64_t now = std::max(done, total - left);
    if (progress.step(now - done)) progress.show(concat(left, " in the queue"));
    done = now;
    if (left == 0) return;
    for (int i = 0; i < 30; ++i) {
      throw_if_interrupted();
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
  }
}

}  // namespace jade::sweep
