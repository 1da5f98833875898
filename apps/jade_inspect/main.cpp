// SPDX-License-Identifier: Apache-2.0
// Prints the content and the problems of a recording, a data set, a run or a file of Gaussians.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <torch/types.h>
#include <vector>

#include "common/cli.h"
#include "common/dataset_flags.h"
#include "common/shell.h"
#include "jade/config/config.h"
#include "jade/core/error.h"
#include "jade/core/text.h"
#include "jade/data/colmap_scene.h"
#include "jade/data/dataset.h"
#include "jade/gaussians/plane_sweep.h"
#include "jade/gaussians/scene_file.h"
#include "jade/import/clock_offset.h"
#include "jade/recording/event_folder.h"
#include "jade/recording/format.h"
#include "jade/run/checkpoint.h"
#include "jade/run/run_summary.h"
#include "jade/run/thresholds.h"
#include "jade/train/state.h"
#include "jade_inspect/recording.h"
#include "jade_inspect/run.h"
#include "jade_inspect/scene.h"
#include "jade_inspect/summary.h"

using namespace jade;

namespace {

/// Arguments of jade_train, including the keys of the data set that differ from their defaults.
/// Thresholds need no flag: jade_train measures them as this program does.
std::string training_arguments(data::DatasetOptions options) {
  namespace fs = std::filesystem;
  const fs::path folder = fs::weakly_canonical(options.path);
  std::string flags;
  data::DatasetOptions defaults;
  defaults.path = options.path;
  const auto standard = config::values(fields_of(defaults));
  const auto chosen = config::values(fields_of(options));
  for (size_t i = 0; i < chosen.size(); ++i) {
    const auto& [key, value] = chosen[i];
    if (value == standard[i].second) continue;
    flags += " --set " + apps::shell_word("dataset." + key + "=" + value);
  }
  return apps::shell_word(folder) + flags + " --output " +
         apps::shell_word(apps::folder_apart(fs::path("runs") / folder.filename(), folder));
}

/// Offset between the clocks of events and frames, as a problem; empty if there is none.
std::string clock_problem(const data::Dataset& dataset) {
  constexpr double kLeast_us = 3000;  // the estimate is within 1 ms on data sets of one clock
  if (dataset.events.empty() || dataset.train.empty()) return "";
  std::vector<data::Exposure> exposures;
  for (const data::Exposure& exposure : dataset.train) {
    const bool same = exposure.blurry.sizes() == dataset.train.front().blurry.sizes();
    if (same && exposure.duration_us() > 0) exposures.push_back(exposure);
  }
  const import::ClockOffset found = import::estimate_clock_offset(exposures, dataset.events);
  if (found.ambiguous() || std::abs(found.offset_us) < std::max(kLeast_us, 3 * found.error_us)) {
    return "";
  }
  const auto ms = static_cast<double>(std::llround(found.offset_us / 100)) / 10;
  return concat(dataset.root.string(), ": events are ", std::abs(ms), " ms ",
                ms > 0 ? "later" : "earlier", " than the changes of the frames that caused them ",
                "(correlation ", static_cast<double>(std::llround(100 * found.correlation)) / 100,
                "): the clocks differ; ", ms > 0 ? "subtract that from" : "add that to",
                " the times of the events");
}

ExitCode inspect(const train::RunOptions& settings, double log_offset,
                 const apps::Program& program) {
  const data::DatasetOptions& options = settings.dataset;
  apps::Inspection inspection;
  inspection.log_offset = log_offset;
  inspection.next = program.command("jade_train") + " " + training_arguments(options);
  inspection.dataset = data::load_dataset(options, &inspection.problems);
  inspection.thresholds = run::measure_thresholds(
      inspection.dataset, run::data_fingerprint(inspection.dataset), log_offset, settings.cache);
  if (inspection.thresholds.flip) {
    inspection.problems.push_back(run::flip_warning(inspection.dataset, inspection.thresholds));
  }
  if (const std::string clock = clock_problem(inspection.dataset); !clock.empty()) {
    inspection.problems.push_back(clock);
  }
  if (const std::string fault = gaussians::pose_fault(train::init_sources(inspection.dataset));
      !fault.empty()) {
    inspection.problems.push_back(fault);
  }
  inspection.pattern = data::estimate_pattern(inspection.dataset);
  if (program.json()) {
    std::printf("%s\n", apps::to_json(inspection)
                            .dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace)
                            .c_str());
  } else {
    apps::print_text(inspection);
  }
  return ExitCode::kOk;
}

/// "; for its events give one of: a.h5, b.h5"; empty if there are none.
std::string hint_of_events(const std::filesystem::path& folder) {
  const std::vector<std::string> files = recording::unfound_events(folder);
  return files.empty() ? "" : concat("; for its events give one of: ", listing(files));
}

/// For an unrecognised folder, reports what it could have been; for a damaged model, the damage.
void check_is_dataset(const data::DatasetOptions& options) {
  if (options.kind != data::DatasetKind::kAuto || !std::filesystem::is_directory(options.path))
    return;
  try {
    data::recognise_dataset(options.path);
  } catch (const DataError&) {
    if (!data::find_colmap_model(options.path).empty()) throw;
    throw DataError(concat(options.path.string(),
                           ": expected a recording (events, or frames that have times), a data set "
                           "(poses_bounds.npy, sparse/0 or transforms.json) or a run directory, "
                           "found none of them",
                           data::other_finding(options.path), hint_of_events(options.path)));
  }
}

}  // namespace

int main(int argc, char** argv) {
  apps::Program program(
      "jade_inspect",
      "Says what is in a recording, a data set, a run or a file of Gaussians, and every problem "
      "found");
  program.add_example("jade_inspect table.aedat4");
  program.add_example("jade_inspect runs/table --json");
  apps::add_dataset_flags(
      program, "path",
      concat("A recording, the folder of a data set, the run directory of "
             "jade_train, or Gaussians in ",
             gaussians::kReadEndings, "; without it, the data set of --config"));
  double log_offset = 0;
  program.cli()
      .add_option("--log-offset", log_offset,
                  "Offset of a sensor that measures log(I + offset), I in [0,1]; the "
                  "measured thresholds depend on it")
      ->check(apps::within(0, 1000))
      ->capture_default_str();
  recording::ReadOptions how;
  program.cli()
      .add_option("--events-group", how.events_group,
                  "Group or data set to read from an HDF5 file with several event streams")
      ->type_name("NAME");
  program.cli()
      .add_option("--topic", how.topic,
                  "Topic (ROS) or camera (AEDAT4) of the events, if a file has several")
      ->type_name("NAME");
  program.cli()
      .add_option("--frames-topic", how.frames_topic,
                  "Topic (ROS) or camera (AEDAT4) of the frames, if a file has several")
      ->type_name("NAME");
  program.add_json_flag();
  return program.run(argc, argv, [&] {
    const torch::NoGradGuard no_grad;
    const auto settings = apps::load_settings(program);
    if (!settings) return ExitCode::kOk;
    const std::filesystem::path& path = settings->dataset.path;
    if (path.empty()) {
      throw ConfigError(
          "expected a recording, the folder of a data set, a run directory or Gaussians, found "
          "nothing; --help lists the flags");
    }
    if (!std::filesystem::exists(path)) {
      throw DataError(concat(path.string(),
                             ": expected a recording, the folder of a data set, a run directory or "
                             "Gaussians, found nothing"));
    }
    if (!std::filesystem::is_regular_file(path) && !std::filesystem::is_directory(path)) {
      throw DataError(concat(path.string(),
                             ": expected a file or a folder, found a pipe or a "
                             "device; store what it sends in a file first"));
    }
    gaussians::refuse_foreign_scene(path);
    if (gaussians::scene_kind(path)) {
      apps::inspect_scene(path, program.json());
      return ExitCode::kOk;
    }
    if (run::is_run(path)) {
      apps::inspect_run(path, program.command("jade_train"), program.json());
      return ExitCode::kOk;
    }
    if (std::filesystem::is_regular_file(path) || recording::is_recording(path)) {
      how.time_unit = settings->dataset.events_unit;
      apps::inspect_recording(path, how, program.command("jade_import"), program.json());
      return ExitCode::kOk;
    }
    check_is_dataset(settings->dataset);
    return inspect(*settings, log_offset, program);
  });
}
