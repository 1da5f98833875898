// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstdlib>
#include <fcntl.h>
#include <nlohmann/json.hpp>
#include <sched.h>
#include <sys/file.h>
#include <thread>
#include <unistd.h>

#include "common/cli.h"
#include "jade/core/atomic_file.h"
#include "jade/core/device.h"
#include "jade/core/interrupt.h"
#include "jade/core/log.h"
#include "jade/core/progress.h"
#include "jade/sweep/local.h"
#include "jade/sweep/results.h"
#include "jade/sweep/slurm.h"
#include "jade/sweep/task.h"
#include "jade/train/options.h"
#include "jade_sweep/resolve.h"

using namespace jade;

namespace {

namespace fs = std::filesystem;

struct Flags {
  fs::path sweep;
  std::vector<std::string> rows, scenes, data, devices, slurm;
  std::vector<int64_t> seeds;
  int jobs = 0;
  double margin_gib = 1;
  std::string launcher = "local", task;
  fs::path program;
  bool dry_run = false, skip_missing = false, retry_failed = false, table = false, wait = false;
};

void add_flags(CLI::App& cli, Flags& flags) {
  cli.add_option("--sweep", flags.sweep,
                 "YAML of the sweep: rows, scenes, seeds (configs/sweeps/)");
  cli.add_option("--rows", flags.rows, "Only these rows, separated by commas")->delimiter(',');
  cli.add_option("--scenes", flags.scenes, "Only these scenes")->delimiter(',');
  cli.add_option("--seeds", flags.seeds, "These seeds instead of the sweep's")->delimiter(',');
  cli.add_option("--data", flags.data, "A scene's data set: SCENE=DIR (repeatable)")
      ->allow_extra_args(false);
  cli.add_option("--jobs", flags.jobs, "Runs at once (default: the sweep's, else one a device)")
      ->check(CLI::Range(1, 100000));
  cli.add_option("--devices,--device", flags.devices, "auto, cpu, or GPUs such as cuda:0,cuda:1")
      ->delimiter(',');
  cli.add_option("--memory-margin", flags.margin_gib, "GiB of memory that stay free")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 1e6));
  cli.add_option("--launcher", flags.launcher,
                 "local: child processes; slurm: a job array through sbatch")
      ->capture_default_str()
      ->check(CLI::IsMember({"local", "slurm"}));
  cli.add_option("--slurm", flags.slurm,
                 "More for sbatch, such as --slurm=--partition=gpu (repeatable)")
      ->allow_extra_args(false);
  cli.add_flag("--wait", flags.wait, "With slurm: wait for the array, then write the table");
  cli.add_flag("--dry-run", flags.dry_run, "Check everything and list the runs; start nothing");
  cli.add_flag("--table", flags.table, "Only write the table anew from what is there");
  cli.add_flag("--skip-missing", flags.skip_missing,
               "Leave out runs whose data or files are not there");
  cli.add_flag("--retry-failed", flags.retry_failed, "Start diverged runs again too");
  cli.add_option("--train-program", flags.program,
                 "The program that trains (default: jade_train beside this one)");
  cli.add_option("--run-task", flags.task,
                 "One run of --output, ROW/SCENE/SEED; what a job array's tasks call");
}

fs::path own_path() { return fs::read_symlink("/proc/self/exe"); }

int usable_cores() {
  cpu_set_t cores;
  return sched_getaffinity(0, sizeof cores, &cores) == 0 ? std::max(1, CPU_COUNT(&cores)) : 1;
}

/// The words of --devices as a list of devices that are there.
std::vector<std::string> devices_of(const Flags& flags) {
  std::vector<std::string> list;
  for (const std::string& word :
       flags.devices.empty() ? std::vector<std::string>{"auto"} : flags.devices) {
    if (word == "auto" && cuda_device_count() > 0) {
      for (int i = 0; i < cuda_device_count(); ++i) list.push_back(concat("cuda:", i));
    } else {
      const torch::Device device = select_device(word);
      list.push_back(device.is_cpu() ? "cpu"
                                     : concat("cuda:", device.has_index() ? device.index() : 0));
    }
  }
  return list;
}

sweep::Plan plan_of(const apps::Program& program, const Flags& flags) {
  sweep::PlanOptions options;
  if (!program.config_file().empty()) options.base.push_back(program.config_file());
  for (const fs::path& layer : program.layers()) options.base.push_back(layer);
  options.overrides = program.overrides();
  options.rows = flags.rows;
  options.scenes = flags.scenes;
  options.seeds = flags.seeds;
  options.skip_missing = flags.skip_missing;
  for (const std::string& entry : flags.data) {
    const size_t equals = entry.find('=');
    if (equals == std::string::npos) throw ConfigError("--data " + entry + ": expected SCENE=DIR");
    options.data[entry.substr(0, equals)] = entry.substr(equals + 1);
  }
  return sweep::make_plan(sweep::read_spec(flags.sweep), options, apps::resolve_training);
}

/// Holds the sweep's folder against a second launcher.
class FolderLock {
 public:
  explicit FolderLock(const fs::path& folder) {
    handle_ = open((folder / ".lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
    if (handle_ < 0 || flock(handle_, LOCK_EX | LOCK_NB) != 0) {
      throw DataError(
          concat(folder.string(),
                 ": another jade_sweep works here; wait for it or choose another --output"));
    }
  }
  ~FolderLock() { close(handle_); }
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  int handle_;
};

void list_runs(const sweep::Plan& plan, const sweep::SweepOutput& output) {
  for (const sweep::Run& run : plan.runs) {
    std::cout << sweep::to_string(output.state(run.id())) << "  " << run.id() << "  steps "
              << run.value("train.iterations") << "\n";
  }
  for (const std::string& skipped : plan.skipped) std::cout << "skipped  " << skipped << "\n";
  std::cout << plan.runs.size() << " runs\n";
}

/// One run as a task of a job array: its exit code is ours.
ExitCode run_task(const sweep::SweepOutput& output, const Flags& flags, const fs::path& program) {
  if (!fs::exists(output.settings_file(flags.task))) {
    throw ConfigError(concat("--run-task ", flags.task, ": expected a run of ",
                             output.folder().string(), ", found none of that name"));
  }
  const sweep::RunState state = output.state(flags.task);
  if (state == sweep::RunState::kRunning) {
    throw DataError(concat(flags.task, ": another process trains it now"));
  }
  if (!sweep::wants_attempt(output, flags.task, flags.retry_failed)) {
    log_info(concat(flags.task, ": ", sweep::to_string(state), " already"));
    return state == sweep::RunState::kFinished ? ExitCode::kOk : ExitCode::kNumeric;
  }
  sweep::TaskOptions options;
  options.program = program;
  options.device = flags.devices.empty() ? "auto" : flags.devices.front();
  options.retry_failed = flags.retry_failed;
  sweep::Task task(output, flags.task, options);
  for (bool told = false;;) {
    if (const auto outcome = task.poll()) {
      log_info(concat(flags.task, ": ", sweep::describe(*outcome)));
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

/// Waits until Slurm has nothing of ours left, with the table kept up to date.
void wait_for_slurm(const sweep::Plan& plan, const sweep::SweepOutput& output) {
  const auto total = static_cast<int64_t>(plan.runs.size());
  Progress progress("slurm", total, 0, "runs");
  for (int64_t done = 0;;) {
    const auto left = static_cast<int64_t>(sweep::queued_runs(output).size());
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

ExitCode conclude(const sweep::Plan& plan, const sweep::SweepOutput& output, bool json) {
  const sweep::Table table = sweep::gather(plan, output);
  sweep::write_table(table, output.folder());
  int finished = 0, failed = 0;
  ExitCode code = ExitCode::kOk;
  for (const sweep::RunRow& run : table.runs) {
    finished += run.state == sweep::RunState::kFinished;
    if (run.state != sweep::RunState::kFailed) continue;
    if (++failed == 1) {
      code = static_cast<ExitCode>(
          output.outcome(sweep::Run::concat_id(run.row, run.scene, run.seed)).exit_code);
    }
  }
  const size_t unfinished = table.runs.size() - static_cast<size_t>(finished + failed);
  const std::string path = (output.folder() / "table.md").string();
  if (json) {
    std::cout << nlohmann::ordered_json{{"runs", table.runs.size()},
                                        {"finished", finished},
                                        {"failed", failed},
                                        {"unfinished", unfinished},
                                        {"table", path}}
                     .dump()
              << "\n";
  } else {
    std::cout << finished << " of " << table.runs.size() << " runs finished, " << failed
              << " failed, " << unfinished << " unfinished; " << path << "\n";
  }
  return code;
}

void launch_local(const sweep::Plan& plan, const sweep::SweepOutput& output, const Flags& flags,
                  const fs::path& program) {
  sweep::LocalOptions options;
  options.program = program;
  options.devices = devices_of(flags);
  options.jobs = flags.jobs > 0       ? flags.jobs
                 : plan.spec.jobs > 0 ? plan.spec.jobs
                                      : static_cast<int>(options.devices.size());
  options.cores = usable_cores();
  options.retry_failed = flags.retry_failed;
  options.memory_margin = static_cast<int64_t>(flags.margin_gib * (1 << 30));
  options.on_end = [&] { sweep::write_table(sweep::gather(plan, output), output.folder()); };
  try {
    sweep::run_local(plan, output, options, sweep::machine_memory());
  } catch (const Interrupted&) {
    sweep::write_table(sweep::gather(plan, output), output.folder());
    throw;
  }
}

void launch_slurm(const sweep::Plan& plan, const sweep::SweepOutput& output, const Flags& flags) {
  sweep::SlurmOptions options;
  options.self = own_path();
  options.program = flags.program;
  options.jobs = flags.jobs;
  options.arguments = flags.slurm;
  options.device = flags.devices.empty() ? "auto" : flags.devices.front();
  options.retry_failed = flags.retry_failed;
  const sweep::Submission submission = sweep::submit(plan, output, options);
  if (!submission.job.empty()) {
    log_info(concat("submitted job array ", submission.job, " of ", submission.submitted, " runs"));
  }
  if (submission.queued > 0) log_info(concat(submission.queued, " runs are in the queue already"));
  if (flags.wait) wait_for_slurm(plan, output);
}

ExitCode run(apps::Program& program, const Flags& flags) {
  if (program.cli().count("--print-config") + program.cli().count("--print-schema") > 0) {
    program.load_options<train::RunOptions>();
    return ExitCode::kOk;
  }
  if (program.output().empty())
    throw ConfigError(
        "--output: expected a folder for the sweep, found nothing; add --output runs/NAME");
  const sweep::SweepOutput output(fs::absolute(program.output()).lexically_normal());
  const fs::path trainer =
      flags.program.empty() ? own_path().parent_path() / "jade_train" : fs::absolute(flags.program);
  if (!fs::exists(trainer))
    throw ConfigError(concat("--train-program: no such program: ", trainer.string()));
  if (!flags.task.empty()) return run_task(output, flags, trainer);
  if (flags.sweep.empty())
    throw ConfigError(
        "--sweep: expected the YAML of a sweep, found nothing; configs/sweeps/ has the paper's");
  const sweep::Plan plan = plan_of(program, flags);
  for (const std::string& skipped : plan.skipped) log_warn("left out: " + skipped);
  if (flags.dry_run) {
    list_runs(plan, output);
    return ExitCode::kOk;
  }
  make_writable_folder(output.folder());
  const FolderLock lock(output.folder());
  output.write_settings(plan, apps::resolve_training);
  write_file(output.folder() / "sweep.yaml", read_file(flags.sweep));
  if (!flags.table && flags.launcher == "local") launch_local(plan, output, flags, trainer);
  if (!flags.table && flags.launcher == "slurm") launch_slurm(plan, output, flags);
  return conclude(plan, output, program.json());
}

}  // namespace

int main(int argc, char** argv) {
  apps::Program program(
      "jade_sweep",
      "Trains rows x scenes x seeds of one YAML and writes one table; called again it goes on");
  program.add_config_flags();
  program.add_output_flag("Folder of the sweep: runs/, tasks/, table.md, table.csv, table.tex");
  program.add_json_flag();
  Flags flags;
  add_flags(program.cli(), flags);
  return program.run(argc, argv, [&] { return run(program, flags); });
}
