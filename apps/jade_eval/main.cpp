// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "common/cli.h"
#include "common/dataset_flags.h"
#include "jade/config/config.h"
#include "jade/core/atomic_file.h"
#include "jade/core/device.h"
#include "jade/eval/folders.h"
#include "jade/run/evaluate.h"
#include "jade/train/view.h"

using namespace jade;
namespace fs = std::filesystem;

namespace {

/// Key and value of each setting that the scores of a run depend on.
std::vector<std::pair<std::string, std::string>> scoring_values(const train::RunOptions& options) {
  train::RunOptions scoring;
  scoring.dataset = apps::with_whole_paths(options.dataset);
  scoring.exposure = options.exposure;
  scoring.splat = options.splat;
  scoring.gains = options.gains;
  return config::values(fields_of(scoring));
}

/// Tables take a run's eval.json for the scores under the run's own settings.
/// @throws ConfigError if other scores would replace it.
void check_own_settings(const fs::path& run, const fs::path& folder,
                        const train::RunOptions& options) {
  if (apps::whole_path(folder) != apps::whole_path(run)) return;
  const auto own = scoring_values(run::load_run_options(run)), given = scoring_values(options);
  const auto other = std::mismatch(own.begin(), own.end(), given.begin());
  if (other.first == own.end()) return;
  throw ConfigError(
      concat("--output: expected a folder other than the run's, whose eval.json is "
             "for the run's own ",
             other.first->first, " '", other.first->second, "', found '", other.second->second,
             "'; choose a folder for the other scores"));
}

/// @throws ConfigError if the command line has a setting that folders of images do not need.
void check_no_run_settings(apps::Program& program) {
  const auto refuse = [](const std::string& what) {
    throw ConfigError(concat(what,
                             ": expected with --run, found --renders and --truth, which need "
                             "no data set; take it out"));
  };
  for (const char* flag : apps::kDatasetFlags) {
    if (program.cli().count(flag) > 0) refuse(flag);
  }
  for (const std::string& set : program.overrides()) {
    const std::string key = set.substr(0, set.find('='));
    if (key != "device" && key != "dataset.mask") refuse("--set " + key);
  }
}

eval::Evaluation evaluate_run(const fs::path& path, const train::RunOptions& options,
                              torch::Device device, const eval::Lpips& lpips) {
  const run::FinishedRun run = run::open_run(path, options);
  if (run.dataset.test.empty() && run.dataset.held_out.empty()) {
    throw DataError(concat(run.dataset.root.string(),
                           ": expected sharp test views or held-out exposures to score, found "
                           "neither"));
  }
  const auto gaussians = gaussians::map_parameters(
      run.gaussians, [&](const torch::Tensor& t) { return t.to(device); });
  return run::evaluate_dataset(gaussians, run.dataset, lpips, options);
}

}  // namespace

int main(int argc, char** argv) {
  apps::Program program("jade_eval", "Scores a run, or any two folders of images");
  fs::path run, renders, truth;
  program.add_example("jade_eval --run runs/table");
  program.add_example("jade_eval --renders pictures --truth sharp --json");
  program.begin_group("Input");
  program.cli()
      .add_option("--run", run, "Run directory of jade_train, scored on its sharp test views")
      ->type_name("DIR");
  program.cli()
      .add_option("--renders", renders, "Folder of images or .npy to score")
      ->type_name("DIR");
  program.cli()
      .add_option("--truth", truth, "Folder of true images with the same names")
      ->type_name("DIR");
  apps::add_dataset_flags(program, "--dataset", "Folder of the data set (default: the run's)");
  program.add_output_flag(
      "Folder for eval.json (default: that of --run or --renders); needed to score a run with "
      "settings other than its own");
  program.add_device_flag();
  program.add_json_flag();
  return program.run(argc, argv, [&] {
    const auto options = apps::load_settings(program, run);
    if (!options) return ExitCode::kOk;
    const bool folders = !renders.empty() && !truth.empty();
    if (folders == !run.empty() || renders.empty() != truth.empty()) {
      throw ConfigError(concat("expected --run DIR, or --renders DIR with --truth DIR, found ",
                               run.empty() && renders.empty() && truth.empty() ? "none of them"
                               : folders                                       ? "all of them"
                               : renders.empty()                               ? "no --renders"
                                                                               : "no --truth"));
    }
    if (folders) check_no_run_settings(program);
    if (program.output().extension() == ".json") {
      throw ConfigError(
          concat("--output: expected a folder, into which eval.json is written, found ",
                 program.output().string()));
    }
    const fs::path folder = !program.output().empty() ? program.output()
                            : run.empty()             ? renders
                                                      : run;
    if (!run.empty()) check_own_settings(run, folder, *options);
    if (!program.output().empty()) make_writable_folder(program.output());
    const torch::Device device = select_device(options->device);
    const eval::Lpips lpips(device);
    const eval::Evaluation evaluation =
        run.empty() ? eval::compare_folders(renders, truth, lpips, options->dataset.mask)
                    : evaluate_run(run, *options, device, lpips);
    write_file(folder / "eval.json", eval::to_json(evaluation));
    std::cout << (program.json() ? eval::to_json(evaluation) : eval::to_table(evaluation));
    return ExitCode::kOk;
  });
}
