// SPDX-License-Identifier: Apache-2.0
#include "run.h"

#include <chrono>
#include <cstdio>
#include <iostream>
#include <nlohmann/json.hpp>

#include "curve.h"
#include "jade/core/atomic_file.h"
#include "jade/core/check.h"
#include "jade/core/device.h"
#include "jade/core/interrupt.h"
#include "jade/core/progress.h"
#include "jade/run/trainer.h"
#include "run_input.h"
#include "timing.h"

namespace jade::bench {
namespace {

/// Runs while the program prepares and trains; paused while it scores.
class Stopwatch {
 public:
  explicit Stopwatch(torch::Device device) : device_(device) {}
  void start() { since_ = Clock::now(); }
  /// Waits for the device, so that a running step is included.
  void stop() {
    synchronize(device_);
    seconds_ += std::chrono::duration<double>(Clock::now() - since_).count();
  }
  double seconds() const { return seconds_; }

 private:
  using Clock = std::chrono::steady_clock;
  torch::Device device_;
  Clock::time_point since_;
  double seconds_ = 0;
};

struct Curve {
  double prepare_seconds = 0;
  std::vector<Milestone> milestones;
};

/// @param input  output folder for the run's inputs; empty: none
Curve train(const train::RunOptions& options, const std::filesystem::path& folder, int64_t every,
            const std::filesystem::path& input, torch::Device device) {
  if (!input.empty()) check_run_input(options);  // before a run folder is created
  Curve curve;
  Stopwatch watch(device);
  watch.start();
  run::Trainer trainer(options, folder, {});
  watch.stop();
  curve.prepare_seconds = watch.seconds();
  if (trainer.dataset().test.empty()) {
    throw DataError(concat(options.dataset.path.string(),
                           ": expected sharp test views to score, found none; choose other data or "
                           "dataset.split"));
  }
  if (!input.empty()) write_run_input(trainer, input);
  const int64_t steps = trainer.options().train.iterations;
  Progress progress("time to quality", steps);
  watch.start();
  for (int64_t step = 1; step <= steps; ++step) {
    trainer.step();
    if (step % every == 0 || step == steps) {
      watch.stop();
      curve.milestones.push_back({step, watch.seconds(), trainer.evaluate().mean.psnr});
      watch.start();
    }
    trainer.densify();
    throw_if_interrupted();
    if (progress.step()) progress.show();
  }
  return curve;
}

std::string csv_of(const Curve& curve) {
  std::string text = "step,seconds,psnr\n";
  for (const Milestone& at : curve.milestones) {
    char line[80];
    std::snprintf(line, sizeof line, "%ld,%.3f,%.3f\n", static_cast<long>(at.step), at.seconds,
                  at.psnr);
    text += line;
  }
  return text;
}

nlohmann::json json_of(const Milestone& at) {
  return {{"step", at.step}, {"seconds", at.seconds}, {"psnr", at.psnr}};
}

void print(const nlohmann::json& result) {
  std::printf("prepared in %.1f s; %ld steps in %.1f s, %.2f dB\n",
              result["prepare_seconds"].get<double>(), result["last"]["step"].get<long>(),
              result["last"]["seconds"].get<double>(), result["last"]["psnr"].get<double>());
  for (const nlohmann::json& goal : result["goals"]) {
    const nlohmann::json& at = goal["reached"];
    if (at.is_null()) {
      std::printf("%.2f dB: not reached\n", goal["psnr"].get<double>());
    } else {
      std::printf("%.2f dB: %.1f s (step %ld, %.2f dB)\n", goal["psnr"].get<double>(),
                  at["seconds"].get<double>(), at["step"].get<long>(), at["psnr"].get<double>());
    }
  }
}

}  // namespace

CLI::App* RunBench::add_to(apps::Program& program) {
  CLI::App* const command = program.cli().add_subcommand(
      "run",
      "Time to quality: trains a configuration and prints after how many seconds its test PSNR "
      "first reached --psnr. Preparation counts; scoring and checkpoints do not");
  command->fallthrough();
  program.add_config_flags(*command);
  program.add_output_flag(*command, "Run directory, with curve.csv; made if it does not exist");
  command->add_option("--psnr", goals, "Goals in dB, such as 28,30")
      ->type_name("LIST")
      ->delimiter(',');
  command->add_option("--every", every, "Steps between two scores")
      ->transform(apps::whole_number(1))
      ->capture_default_str();
  command
      ->add_option("--write-input", input,
                   "Write the initial state of the run as .npy into this folder, for "
                   "scripts/gsplat_training.py")
      ->type_name("DIR")
      ->group("Output");
  return command;
}

ExitCode RunBench::run(const apps::Program& program) const {
  const auto options = program.load_options<train::RunOptions>();
  if (!options) return ExitCode::kOk;
  if (program.output().empty()) {
    throw ConfigError(
        "--output: expected a folder for the run, found nothing; add --output runs/NAME");
  }
  const Curve curve =
      train(*options, program.output(), every, input, select_device(options->device));
  write_file(program.output() / "curve.csv", csv_of(curve));
  nlohmann::json result{{"prepare_seconds", curve.prepare_seconds},
                        {"goals", nlohmann::json::array()},
                        {"last", json_of(curve.milestones.back())},
                        {"curve", nlohmann::json::array()}};
  for (const double goal : goals) {
    const Milestone* const at = reached(curve.milestones, goal);
    result["goals"].push_back({{"psnr", goal}, {"reached", at ? json_of(*at) : nlohmann::json()}});
  }
  for (const Milestone& at : curve.milestones) result["curve"].push_back(json_of(at));
  if (program.json()) {
    std::cout << result.dump(2) << '\n';
  } else {
    print(result);
  }
  return ExitCode::kOk;
}

}  // namespace jade::bench
