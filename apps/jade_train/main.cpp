// SPDX-License-Identifier: Apache-2.0
#include <memory>

#include "common/cli.h"
#include "common/dataset_flags.h"
#include "common/shell.h"
#include "jade/config/config.h"
#include "jade/core/log.h"
#include "jade/gaussians/scene_file.h"
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

/// Whether a resumed run has stored settings, so that the user need not name them again.
bool knows_settings(const std::filesystem::path& config, const std::filesystem::path& run,
                    bool resumed) {
  return resumed && config.empty() && std::filesystem::exists(run / "config.yaml");
}

/// The command that continues a run.
std::string resume_command(const fs::path& run, const apps::Program& program) {
  return concat(program.command("jade_train"), " --output ", apps::shell_word(run), " --resume");
}

/// Resolves the positional argument: a scene's YAML, a data set, which may have one, or a
/// recording, which must be imported first.
void use_path(const fs::path& path, apps::Program& program) {
  if (path.empty()) return;
  const bool is_yaml = path.extension() == ".yaml" || path.extension() == ".yml";
  if (is_yaml) return program.use_config(path);
  if (run::is_run(path)) {
    throw ConfigError(concat(
        path.string(), ": expected a data set or a scene.yaml, found a run; continue it with ",
        resume_command(path, program)));
  }
  if (!fs::exists(path)) {
    throw DataError(concat(path.string(),
                           ": expected the folder of a data set or a scene.yaml, found nothing"));
  }
  gaussians::refuse_foreign_scene(path);
  if (gaussians::scene_kind(path)) {
    throw ConfigError(
        concat(path.string(),
               ": expected a data set with poses or a scene.yaml, found Gaussians; look at "
               "them with ",
               program.command("jade_view"), " ", apps::shell_word(path)));
  }
  // The error for a file that is no recording lists the formats.
  if (fs::is_regular_file(path)) recording::recognise(path);
  if (fs::is_regular_file(path) || recording::is_recording(path)) {
    throw ConfigError(concat(path.string(),
                             ": expected a data set with poses or a scene.yaml, found a recording; "
                             "import it with ",
                             program.command("jade_import"), " ", apps::shell_word(path),
                             " --output DIR"));
  }
  if (fs::is_regular_file(path / "scene.yaml")) return program.use_config(path / "scene.yaml");
  program.use_key("dataset.path", path.string());
}

/// @throws ConfigError if a later --config or --set names another data set than that of the folder.
void check_same_data(const fs::path& path, const fs::path& dataset) {
  if (path.empty() || !fs::is_regular_file(path / "scene.yaml")) return;
  const auto own = config::load<train::RunOptions>({path / "scene.yaml", {}, {}}).dataset.path;
  const auto is = [&](const fs::path& other) {
    return fs::weakly_canonical(other) == fs::weakly_canonical(dataset);
  };
  if (is(own) || is(path)) return;
  throw ConfigError(concat(path.string(), ": expected no other data set in --config and --set, ",
                           "found dataset.path ", dataset.string(), "; leave one of the two away"));
}

/// Says what an interruption before the first step leaves.
template <class Prepare>
std::unique_ptr<run::Trainer> prepared(const Prepare& prepare) {
  try {
    return prepare();
  } catch (const Interrupted&) {
    log_info("interrupted before the first step: no checkpoint; run the same command again");
    throw;
  }
}

}  // namespace

int main(int argc, char** argv) {
  apps::Program program("jade_train",
                        "Trains a sharp 3D Gaussian scene from blurry frames and events");
  program.add_example("jade_train data/table --output runs/table");
  program.add_example("jade_train data/table/scene.yaml --minutes 10 --output runs/short");
  fs::path path;
  program.begin_group("Input");
  program.cli()
      .add_option("path", path,
                  "Folder of a data set, or its scene.yaml: the first --config or dataset.path")
      ->type_name("PATH");
  program.add_config_flags();
  program.add_mask_flag("dataset.mask");
  program.add_output_flag("Run directory; made if it does not exist");
  program.add_device_flag();
  program.add_seed_flag();
  std::string resume;
  program.begin_group("Training");
  auto* resume_flag = program.cli().add_option(
      "--resume", resume,
      "Continue the run in --output from its newest complete checkpoint, or from this one; without "
      "--config with the settings of the run");
  resume_flag->type_name("FILE")->expected(0, 1);
  run::Choices choices;
  auto* minutes = program.cli().add_option(
      "--minutes", choices.minutes,
      "Approximate length of the run: chooses the steps and moments that are not set, by the "
      "measured speed of this machine");
  minutes->check(apps::within(0.5, 1e5));
  std::string address;
  program.begin_group("Output");
  const auto* serve = program.add_serve_flag(address, "Show the scene in a browser as it trains,");
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
          "expected a data set, found nothing; add its folder or its scene.yaml: jade_train PATH "
          "--output DIR");
    }
    if (resumed && choices.minutes > 0) {
      throw ConfigError(
          "--minutes: chooses the steps of a new run, found --resume; leave one away");
    }
    check_same_data(path, options->dataset.path);
    if (!resumed) apps::check_run_apart(program.output(), options->dataset);
    if (resumed && resume.empty()) resume = "latest";
    std::optional<serve::Server> server;
    std::optional<run::LiveRun> live;
    if (*serve) {
      // Before minutes of preparation, because the port may be in use.
      server.emplace(serve::parse_address(address, "--serve"), "--serve");
      live.emplace(*server);
      std::cout << server->url() << std::endl;
    }
    const auto trainer = prepared([&] {
      return std::make_unique<run::Trainer>(*options, program.output(), resume,
                                            known ? std::nullopt : std::optional(choices));
    });
    try {
      trainer->run(live ? &*live : nullptr);
    } catch (const Interrupted&) {
      log_info("go on with " + resume_command(program.output(), program));
      throw;
    }
    return ExitCode::kOk;
  });
}
