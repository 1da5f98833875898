// SPDX-License-Identifier: Apache-2.0
#include "common/cli.h"
#include "common/dataset_flags.h"
#include "jade/run/evaluate.h"
#include "jade/run/live_run.h"
#include "jade/run/trainer.h"
#include "jade/serve/server.h"
#include "jade/train/options.h"

using namespace jade;

namespace {

/// What the command line is laid over: a run that goes on knows its settings, so nobody need name
/// them again.
train::RunOptions settings_before(const std::filesystem::path& config,
                                  const std::filesystem::path& run, bool resumed) {
  const bool known = resumed && config.empty() && std::filesystem::exists(run / "config.yaml");
  return known ? run::written_options(run) : train::RunOptions();
}

}  // namespace

int main(int argc, char** argv) {
  apps::Program program("jade_train",
                        "Trains a sharp 3D Gaussian scene from blurry frames and events");
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
  std::string address;
  const auto* serve = program.add_serve_flag(address, "Show the scene in a browser as it trains");
  return program.run(argc, argv, [&] {
    const bool resumed = resume_flag->count() > 0;
    const auto options =
        program.load_options(settings_before(program.config_file(), program.output(), resumed));
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
          "dataset.path: expected the folder of a data set, found nothing; set it in the YAML or "
          "with --set dataset.path=DIR");
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
    run::Trainer trainer(*options, program.output(), resume);
    trainer.run(live ? &*live : nullptr);
    return ExitCode::kOk;
  });
}
