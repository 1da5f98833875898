// SPDX-License-Identifier: Apache-2.0
#include "common/cli.h"
#include "common/dataset_flags.h"
#include "common/shell.h"
#include "jade/recording/format.h"
#include "jade/run/evaluate.h"
#include "jade/run/live_run.h"
#include "jade/run/run_summary.h"
#include "jade/run/trainer.h"
#include "jade/serve/server.h"
#include "jade/train/options.h"

using namespace jade;
namespace fs = std::filesystem;

namespace {

/// A run that goes on knows its settings, so nobody need name them again.
bool knows_settings(const std::filesystem::path& config, const std::filesystem::path& run,
                    bool resumed) {
  return resumed && config.empty() && std::filesystem::exists(run / "config.yaml");
}

/// Resolves the positional argument: a scene's YAML, a data set, which may have one, or a
/// recording, which must be imported first.
void use_path(const fs::path& path, apps::Program& program) {
  const bool is_yaml = path.extension() == ".yaml" || path.extension() == ".yml";
  if (path.empty()) return;
  if (is_yaml) return program.use_config(path);
  if (run::is_run(path)) {
    throw ConfigError(concat(path.string(),
                             ": expected a data set or a scene.yaml, found a run; go on with it by "
                             "jade_train --output ",
                             apps::shell_word(path), " --resume"));
  }
  if (fs::is_regular_file(path) || recording::is_recording(path)) {
    throw ConfigError(concat(path.string(),
                             ": expected a data set with poses or a scene.yaml, found a recording; "
                             "make one of it by jade_import ",
                             apps::shell_word(path), " --output DIR"));
  }
  if (fs::is_regular_file(path / "scene.yaml")) return program.use_config(path / "scene.yaml");
  program.use_key("dataset.path", path.string());
}

}  // namespace

int main(int argc, char** argv) {
  apps::Program program("jade_train",
                        "Trains a sharp 3D Gaussian scene from blurry frames and events");
  fs::path path;
  program.cli().add_option(
      "path", path, "data set, or the YAML of a scene; as dataset.path or the first --config");
  program.add_config_flags();
  program.add_key_flag("--mask", "dataset.mask",
                       "image whose black pixels count in no frame (lens borders, hot areas)");
  program.add_output_flag("Run directory, made if it does not exist");
  program.add_device_flag();
  program.add_seed_flag();
  std::string resume;
  auto* resume_flag = program.cli().add_option(
      "--resume", resume,
      "Go on with the newest whole checkpoint of --output, or with this one; without --config by "
      "the settings of the run");
  resume_flag->expected(0, 1);
  run::Choices choices;
  auto* minutes = program.cli().add_option(
      "--minutes", choices.minutes,
      "About how long the run is to take: steps and moments that are not set are chosen so, by the "
      "measured speed of this machine");
  minutes->check(CLI::Range(0.5, 1e5));
  std::string address;
  const auto* serve = program.add_serve_flag(address, "Show the scene in a browser as it trains");
  return program.run(argc, argv, [&] {
    const bool resumed = resume_flag->count() > 0;
    use_path(path, program);
    const bool known = knows_settings(program.config_file(), program.output(), resumed);
    const auto options = program.load_options(
        known ? run::written_options(program.output()) : train::RunOptions(), &choices.named);
    if (!options) return ExitCode::kOk;
    if (program.output().empty()) {
      throw ConfigError(
          "--output: expected a folder for the run, found nothing; add --output runs/NAME");
    }
    if (resumed && program.config_file().empty() && !std::filesystem::exists(program.output())) {
      throw ConfigError(concat("--resume: expected the folder of a run, found nothing at ",
                               program.output().string(),
                               "; check --output, or leave --resume away to begin one"));
    }
    if (options->dataset.path.empty()) {
      throw ConfigError(
          "dataset.path: expected the folder of a data set, found nothing; name it behind "
          "jade_train, "
          "in the YAML or with --set dataset.path=DIR");
    }
    if (resumed && choices.minutes > 0) {
      throw ConfigError(
          "--minutes: chooses the steps of a new run, found --resume; leave one away");
    }
    if (!resumed) apps::check_run_apart(program.output(), options->dataset);
    if (resumed && resume.empty()) resume = "latest";
    std::optional<serve::Server> server;
    std::optional<run::LiveRun> live;
    if (*serve) {
      // Before minutes of preparation: a port may be taken.
      server.emplace(serve::parse_address(address, "--serve"), "--serve");
      live.emplace(*server);
      std::cout << server->url() << std::endl;
    }
    run::Trainer trainer(*options, program.output(), resume,
                         known ? std::nullopt : std::optional(choices));
    trainer.run(live ? &*live : nullptr);
    return ExitCode::kOk;
  });
}
