// SPDX-License-Identifier: Apache-2.0
#include <map>

#include "common/cli.h"
#include "common/dataset_flags.h"
#include "jade/core/atomic_file.h"
#include "jade/core/device.h"
#include "jade/eval/report.h"
#include "jade/imaging/image_io.h"
#include "jade/run/evaluate.h"
#include "jade/train/view.h"

using namespace jade;
namespace fs = std::filesystem;

namespace {

/// Images of two folders, paired by name without extension.
eval::Evaluation compare_folders(const fs::path& renders, const fs::path& truth,
                                 const eval::Lpips& lpips) {
  std::map<std::string, fs::path> by_name;
  for (const fs::path& path : imaging::list_images(renders)) by_name[path.stem().string()] = path;
  std::vector<eval::Scores> scores;
  for (const fs::path& path : imaging::list_images(truth)) {
    const auto found = by_name.find(path.stem().string());
    if (found == by_name.end()) {
      throw DataError(concat(renders.string(), ": expected an image named ", path.stem().string(),
                             " as in ", truth.string(), ", found none"));
    }
    const auto image = imaging::read_image(found->second), reference = imaging::read_image(path);
    if (image.sizes() != reference.sizes()) {
      throw DataError(concat(found->second.string(), ": expected ", reference.size(2), "x",
                             reference.size(1), " as ", path.string(), ", found ", image.size(2),
                             "x", image.size(1)));
    }
    scores.push_back(eval::score(path.stem().string(), image, reference, &lpips));
  }
  if (scores.empty()) throw DataError(concat(truth.string(), ": expected images, found none"));
  return eval::evaluation_of(std::move(scores));
}

eval::Evaluation evaluate_run(const fs::path& path, const train::RunOptions& options,
                              torch::Device device, const eval::Lpips& lpips) {
  const run::FinishedRun run = run::open_run(path, options);
  if (run.dataset.test.empty()) {
    throw DataError(
        concat(run.dataset.root.string(), ": expected sharp test views to score, found none"));
  }
  const auto gaussians = gaussians::map_parameters(
      run.gaussians, [&](const torch::Tensor& t) { return t.to(device); });
  return run::evaluate_views(gaussians, run.dataset.test, lpips, train::render_options(options));
}

}  // namespace

int main(int argc, char** argv) {
  apps::Program program("jade_eval", "Scores a run, or any two folders of images");
  fs::path run, renders, truth;
  program.cli().add_option("--run", run,
                           "Run directory: its scores on the sharp test views, its settings under "
                           "those given here");
  program.cli().add_option("--renders", renders, "Folder of images to score");
  program.cli().add_option("--truth", truth, "Folder of true images, by the same names");
  apps::add_dataset_flags(program, "--dataset", "Folder of the data set (that of the run)");
  program.add_output_flag("Folder for eval.json (default: that of --run or --renders)");
  program.add_device_flag();
  program.add_json_flag();
  return program.run(argc, argv, [&] {
    const auto options = apps::load_settings(program, run);
    if (!options) return ExitCode::kOk;
    const bool folders = !renders.empty() && !truth.empty();
    if (folders == !run.empty() || renders.empty() != truth.empty()) {
      throw ConfigError("expected --run DIR, or --renders DIR with --truth DIR");
    }
    const torch::Device device = select_device(options->device);
    const eval::Lpips lpips(device);
    const eval::Evaluation evaluation = run.empty() ? compare_folders(renders, truth, lpips)
                                                    : evaluate_run(run, *options, device, lpips);
    const fs::path folder = !program.output().empty() ? program.output()
                            : run.empty()             ? renders
                                                      : run;
    write_file(folder / "eval.json", eval::to_json(evaluation));
    std::cout << (program.json() ? eval::to_json(evaluation) : eval::to_table(evaluation));
    return ExitCode::kOk;
  });
}
