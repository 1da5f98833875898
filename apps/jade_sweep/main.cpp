// SPDX-License-Identifier: Apache-2.0
#include <nlohmann/json.hpp>
#include <unistd.h>

#include "common/cli.h"
#include "jade/core/atomic_file.h"
#include "jade/core/folder_lock.h"
#include "jade/core/log.h"
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

void add_flags(apps::Program& program, Flags& flags) {
  CLI::App& cli = program.cli();
  program.begin_group("Input");
  cli.add_option("--sweep", flags.sweep, "YAML of the sweep: rows, scenes, seeds (configs/sweeps/)")
      ->type_name("FILE");
  cli.add_option("--data", flags.data, "Data set of one scene. Repeatable")
      ->type_name("SCENE=DIR")
      ->allow_extra_args(false);
  program.begin_group("Selection");
  cli.add_option("--rows", flags.rows, "Only these rows, separated by commas")
      ->type_name("LIST")
      ->delimiter(',');
  cli.add_option("--scenes", flags.scenes, "Only these scenes, separated by commas")
      ->type_name("LIST")
      ->delimiter(',');
  cli.add_option("--seeds", flags.seeds, "These seeds instead of those of the sweep")
      ->type_name("LIST")
      ->delimiter(',')
      ->transform(apps::whole_number(0));
  cli.add_flag("--skip-missing", flags.skip_missing,
               "Skip runs whose data sets or files do not exist");
  cli.add_flag("--retry-failed", flags.retry_failed, "Also start diverged runs again");
  cli.add_flag("--dry-run", flags.dry_run, "Check everything and list the runs; start nothing");
  cli.add_flag("--table", flags.table, "Only write the table of the finished runs");
  program.begin_group("Machines");
  cli.add_option("--jobs", flags.jobs,
                 "Most runs at once; by default that of the sweep, else six per GPU or one per two "
                 "cores")
      ->transform(apps::whole_number(1))
      ->check(CLI::Range(1, sweep::kMostJobs));
  cli.add_option("--devices,--device", flags.devices, "auto, cpu, or GPUs such as cuda:0,cuda:1")
      ->type_name("LIST")
      ->delimiter(',');
  cli.add_option("--memory-margin", flags.margin_gib, "GiB of memory to leave free")
      ->capture_default_str()
      ->check(apps::within(0, 1e5));
  cli.add_option("--launcher", flags.launcher,
                 "local: child processes; slurm: a job array through sbatch")
      ->type_name("WORD")
      ->capture_default_str()
      ->check(CLI::IsMember({"local", "slurm"}));
  cli.add_option("--slurm", flags.slurm,
                 "An argument for sbatch, such as --slurm=-pgpu. Repeatable")
      ->type_name("ARGUMENT")
      ->allow_extra_args(false);
  cli.add_flag("--wait", flags.wait, "With slurm: wait for the array, then write the table");
  cli.add_option("--train-program", flags.program,
                 "Program that trains (default: jade_train beside this one)")
      ->type_name("FILE");
  cli.add_option("--run-task", flags.task,
                 "Run one task of a job array in --output; the array's script calls this")
      ->type_name("ROW/SCENE/SEED");
}

fs::path own_path() { return fs::read_symlink("/proc/self/exe"); }

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

void list_runs(const sweep::Plan& plan, const sweep::SweepOutput& output) {
  for (const sweep::Run& run : plan.runs) {
    std::cout << sweep::to_string(output.state(run.id())) << "  " << run.id() << "  steps "
              << run.value("train.iterations") << "\n";
  }
  for (const std::string& skipped : plan.skipped) std::cout << "skipped  " << skipped << "\n";
  std::cout << plan.runs.size() << " runs\n";
}

/// Runs one task of a job array; its exit code becomes the program's.
ExitCode run_task(const sweep::SweepOutput& output, const Flags& flags, const fs::path& program) {
  sweep::TaskOptions options;
  options.program = program;
  options.device = flags.devices.empty() ? "auto" : flags.devices.front();
  options.retry_failed = flags.retry_failed;
  return sweep::run_task(output, flags.task, options);
}

ExitCode conclude(const sweep::Plan& plan, const sweep::SweepOutput& output, bool json) {
  const sweep::Table table = sweep::gather(plan, output);
  sweep::write_table(table, output.folder());
  const sweep::Standing now = sweep::standing_of(table, output);
  const std::string path = (output.folder() / "table.md").string();
  if (json) {
    std::cout << nlohmann::ordered_json{{"runs", now.runs},
                                        {"finished", now.finished},
                                        {"failed", now.failed},
                                        {"unfinished", now.unfinished},
                                        {"table", path},
                                        {"page", (output.folder() / "index.html").string()}}
                     .dump()
              << "\n";
  } else {
    std::cout << now.finished << " of " << now.runs << " runs finished, " << now.failed
              << " failed, " << now.unfinished << " unfinished; " << path << " and index.html\n";
  }
  return now.code;
}

void launch_local(const sweep::Plan& plan, const sweep::SweepOutput& output, const Flags& flags,
                  const fs::path& program) {
  sweep::LocalOptions options;
  options.program = program;
  options.devices =
      sweep::devices_of(flags.devices.empty() ? std::vector<std::string>{"auto"} : flags.devices);
  options.cores = sweep::usable_cores();
  options.jobs = flags.jobs > 0       ? flags.jobs
                 : plan.spec.jobs > 0 ? plan.spec.jobs
                                      : sweep::jobs_for(options.devices, options.cores,
                                                        static_cast<int>(plan.runs.size()));
  if (flags.jobs == 0)
    log_info(concat("at most ", options.jobs, options.jobs == 1 ? " run" : " runs",
                    " at once; --jobs sets it"));
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

/// Whether runs remain in the queue, from this call or from earlier ones.
bool launch_slurm(const sweep::Plan& plan, const sweep::SweepOutput& output, const Flags& flags) {
  sweep::SlurmOptions options;
  options.self = own_path();
  options.program = flags.program;
  options.jobs = flags.jobs > 0 ? flags.jobs : plan.spec.jobs;
  options.arguments = flags.slurm;
  options.device = flags.devices.empty() ? "auto" : flags.devices.front();
  options.retry_failed = flags.retry_failed;
  const sweep::Submission submission = sweep::submit(plan, output, options);
  if (!submission.job.empty()) {
    log_info(concat("submitted job array ", submission.job, " of ", submission.submitted, " runs"));
  }
  if (submission.queued > 0) log_info(concat(submission.queued, " runs are in the queue already"));
  if (flags.wait) sweep::wait_for_slurm(plan, output);
  return !flags.wait && submission.submitted + submission.queued > 0;
}

/// Refuses flags that the others make useless.
void check_flags(apps::Program& program, const Flags& flags) {
  const auto refuse = [&](const char* flag, const char* with, const std::string& found) {
    if (program.cli().count(flag) > 0)
      throw ConfigError(concat(flag, ": expected ", with, ", found ", found,
                               "; change or take out one of the two"));
  };
  if (flags.table) {
    for (const char* flag : {"--launcher", "--slurm", "--wait", "--retry-failed", "--dry-run"})
      refuse(flag, "without --table, which starts no runs", "both");
  }
  if (flags.dry_run) refuse("--json", "without --dry-run, which prints a list", "both");
  if (flags.launcher == "slurm") {
    refuse("--memory-margin", "with --launcher local", "--launcher slurm");
  } else {
    for (const char* flag : {"--slurm", "--wait"})
      refuse(flag, "with --launcher slurm", "--launcher local");
  }
}

ExitCode run(apps::Program& program, Flags& flags) {
  if (program.cli().count("--print-config") + program.cli().count("--print-schema") > 0) {
    program.load_options<train::RunOptions>();
    return ExitCode::kOk;
  }
  check_flags(program, flags);
  if (program.output().empty())
    throw ConfigError(
        "--output: expected a folder for the sweep, found nothing; add --output runs/NAME");
  const sweep::SweepOutput output(fs::absolute(program.output()).lexically_normal());
  const fs::path trainer =
      flags.program.empty() ? own_path().parent_path() / "jade_train" : fs::absolute(flags.program);
  if (!fs::is_regular_file(trainer) || access(trainer.c_str(), X_OK) != 0)
    throw ConfigError(concat("--train-program: expected a program, found ",
                             fs::exists(trainer) ? "what cannot be run" : "nothing", " at ",
                             trainer.string()));
  if (!flags.task.empty()) return run_task(output, flags, trainer);
  if (flags.sweep.empty())
    throw ConfigError(
        "--sweep: expected the YAML of a sweep, found nothing; configs/sweeps/ has the paper's");
  flags.sweep = apps::settings_file(flags.sweep);
  const sweep::Plan plan = plan_of(program, flags);
  for (const std::string& skipped : plan.skipped) log_warn("left out: " + skipped);
  if (flags.dry_run) {
    output.check_settings(plan, apps::resolve_written);
    list_runs(plan, output);
    return ExitCode::kOk;
  }
  make_writable_folder(output.folder());
  const auto lock = FolderLock::take(output.folder());
  if (!lock) {
    throw DataError(
        concat(output.folder().string(),
               ": another jade_sweep works here; wait for it or choose another --output"));
  }
  if (flags.table) {
    output.check_settings(plan, apps::resolve_written, /*starts=*/false);
  } else {
    output.write_settings(plan, apps::resolve_written);
  }
  write_file(output.folder() / "sweep.yaml", read_file(flags.sweep));
  if (!flags.table && flags.launcher == "local") launch_local(plan, output, flags, trainer);
  const bool goes_on =
      !flags.table && flags.launcher == "slurm" && launch_slurm(plan, output, flags);
  const ExitCode code = conclude(plan, output, program.json());
  // A call that resubmits failed or killed runs has itself succeeded.
  return goes_on ? ExitCode::kOk : code;
}

}  // namespace

int main(int argc, char** argv) {
  apps::Program program(
      "jade_sweep",
      "Trains every row, scene and seed of one YAML and writes one table; repeat the command to "
      "continue it");
  program.add_example("jade_sweep --sweep configs/sweeps/ablation.yaml --output runs/ablation");
  program.add_example("jade_sweep --sweep my.yaml --seeds 0,1 --dry-run --output runs/mine");
  program.add_config_flags();
  program.set_settings_order("defaults, --config, the scene, the row, --set");
  program.add_output_flag(
      "Folder of the sweep: runs/, tasks/, index.html, table.md, table.csv, table.tex");
  program.add_json_flag();
  Flags flags;
  add_flags(program, flags);
  return program.run(argc, argv, [&] { return run(program, flags); });
}
