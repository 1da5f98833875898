// SPDX-License-Identifier: Apache-2.0
// Restores sharp frames from blurry ones and their events, in 2D only.
#include <algorithm>
#include <torch/types.h>

#include "common/cli.h"
#include "common/dataset_flags.h"
#include "jade/config/config.h"
#include "jade/core/atomic_file.h"
#include "jade/core/device.h"
#include "jade/core/digest.h"
#include "jade/core/error.h"
#include "jade/core/folder_lock.h"
#include "jade/core/log.h"
#include "jade/data/dataset.h"
#include "jade/run/checkpoint.h"
#include "jade/run/deblur.h"
#include "jade/run/thresholds.h"

using namespace jade;

namespace {

struct DeblurFlags {
  run::DeblurOptions options;
  run::DeblurPictures pictures;
  std::string method = "edi";
};

void add_flags(apps::Program& program, DeblurFlags& flags) {
  std::string methods;
  for (const restore::Method& method : restore::methods()) {
    methods += concat(methods.empty() ? "" : "; ", method.name, ": ", method.help);
  }
  CLI::App& cli = program.cli();
  program.add_example("jade_deblur --dataset data/table --method efnet --output sharp");
  program.add_example("jade_deblur --run runs/paper --method router --output sharp");
  program.begin_group("Input");
  cli.add_option("--run", flags.options.run,
                 "Run directory of jade_train: its router, settings and data set")
      ->type_name("DIR");
  apps::add_dataset_flags(program, "--dataset", "Folder of the data set (default: the run's)");
  program.begin_group("Restoration");
  cli.add_option("--method", flags.method, methods)->type_name("WORD")->capture_default_str();
  cli.add_option("--log-offset", flags.options.log_offset,
                 "Offset of a sensor that measures log(I + offset), I in [0,1]")
      ->capture_default_str()
      ->check(apps::within(0, 1000));
  program.add_restoration_flags();
  program
      .add_key_flag("--cache", "cache.folder",
                    "Folder that keeps restorations (default: in the user's cache folder)")
      ->type_name("DIR");
  program.add_key_switch("--no-cache", "cache.enabled", "false",
                         "Neither read nor keep restorations");
  program.begin_group("Output");
  cli.add_flag("--poses", flags.pictures.poses,
               "Also write NAME_<k>.png for each moment of exposure.samples, k from 0 "
               "(zero-padded): restored at "
               "that moment by a restorer of version 2, else moved there from the middle by the "
               "events");
  cli.add_option("--times", flags.pictures.times,
                 "Also write NAME_t<u>.png at these moments, 0 the start and 1 the end of the "
                 "exposure, such as 0,0.5,1; methods that use EFNet need a restorer of version 2")
      ->type_name("LIST")
      ->delimiter(',')
      ->check(apps::within(0, 1));
  cli.add_flag("--npy", flags.pictures.npy,
               "Also write unclamped float32 [3,H,W] beside each picture");
}

/// Names the data set, the method and a digest of the settings in a folder of pictures.
constexpr char kMark[] = "deblur.txt";

std::string mark_of(const DeblurFlags& flags) {
  train::RunOptions settings;
  settings.dataset = apps::with_whole_paths(flags.options.settings.dataset);
  settings.events = flags.options.settings.events;
  settings.exposure = flags.options.settings.exposure;
  settings.efnet = flags.options.settings.efnet;
  Sha256 digest;
  digest.update(config::to_yaml(fields_of(settings), ""));
  digest.update(concat(flags.options.run.string(), "; ", flags.options.log_offset, "; ",
                       flags.pictures.poses, flags.pictures.npy));
  for (const double time : flags.pictures.times) digest.update(concat(' ', time));
  return concat("method ", flags.method, "\ndata set ", settings.dataset.path.string(),
                "\nsettings ", digest.hex().substr(0, 12), "\n");
}

/// Allows a folder without files, or with pictures of the same data set, method and settings, which
/// the new ones replace.
void check_output(const std::filesystem::path& output, const std::string& expected) {
  namespace fs = std::filesystem;
  if (!fs::exists(output)) return;
  if (!fs::is_directory(output))
    throw ConfigError(concat("--output: expected a folder, found the file ", output.string()));
  std::string other;
  for (const auto& entry : fs::directory_iterator(output)) {
    const std::string name = entry.path().filename().string();
    if (name != kMark && name[0] != '.' && name != "Thumbs.db") other = name;
  }
  if (other.empty()) return;
  const fs::path mark = output / kMark;
  if (!fs::is_regular_file(mark)) {
    throw ConfigError(
        concat("--output: expected a new or empty folder, or one of an earlier "
               "jade_deblur, found other files in ",
               output.string(), " (", other, "); choose another"));
  }
  if (read_file(mark) == expected) return;
  std::string found = read_file(mark);
  std::replace(found.begin(), found.end(), '\n', ' ');
  throw ConfigError(
      concat("--output: expected a folder of this method, data set and settings, "
             "found in ",
             output.string(), " pictures of ", found, "; choose another, or remove it"));
}

/// Runs before anything is loaded.
void check_flags(const DeblurFlags& flags, const restore::Method& method,
                 const std::filesystem::path& output) {
  const train::RunOptions& settings = flags.options.settings;
  if (method.needs_run && flags.options.run.empty()) {
    throw ConfigError("--run: method router needs the run directory of jade_train");
  }
  if (settings.dataset.path.empty()) {
    throw ConfigError("--dataset: expected a folder, there or as dataset.path of --config");
  }
  if (output.empty()) throw ConfigError("--output: expected a folder for the pictures");
  apps::check_apart(output, settings.dataset);
  check_output(output, mark_of(flags));
  if (method.needs_truth && !flags.pictures.times.empty()) {
    throw ConfigError(
        concat("--times: method ", method.name,
               " needs a true image, which exists at mid-exposure only; use edi, efnet or mean"));
  }
  if (!method.needs_efnet) return;
  restore::restorer_file_sha256(settings.efnet);
  if (flags.pictures.times.empty()) return;
  const std::filesystem::path network = restore::restorer_path(settings.efnet);
  restore::check_times(network, restore::read_restorer_metadata(network), flags.pictures.times);
}

void check_events(const data::Dataset& dataset) {
  for (const auto* exposures : {&dataset.train, &dataset.held_out}) {
    for (const data::Exposure& exposure : *exposures) {
      if (!exposure.events.empty()) return;
    }
  }
  throw DataError(
      concat(dataset.root.string(),
             ": expected blurry frames with events, found no events in any exposure, so "
             "that nothing can be restored; use a layout with events (docs/data.md)"));
}

ExitCode deblur(DeblurFlags flags, apps::Program& program) {
  const auto settings = apps::load_settings(program, flags.options.run);
  if (!settings) return ExitCode::kOk;
  flags.options.settings = *settings;
  const restore::Method& method = restore::find_method(flags.method);
  const std::filesystem::path& output = program.output();
  check_flags(flags, method, output);
  const std::string mark = mark_of(flags);  // before the data set changes the settings
  const torch::Device device =
      method.needs_efnet ? select_device(settings->device) : torch::Device(torch::kCPU);
  std::vector<std::string> warnings;
  const data::Dataset dataset = data::load_dataset(settings->dataset, &warnings);
  for (const std::string& warning : warnings) log_warn(warning);
  check_events(dataset);
  train::apply_dataset(dataset, flags.options.settings);
  run::settle_thresholds(
      dataset,
      run::measure_thresholds(dataset, run::data_fingerprint(dataset), flags.options.log_offset,
                              flags.options.settings.cache),
      flags.options.settings);
  make_writable_folder(output);
  const auto lock = FolderLock::take(output);
  if (!lock) {
    throw DataError(concat(output.string(),
                           ": another jade_deblur is at work here; wait for it or "
                           "choose another --output"));
  }
  write_file(output / kMark, mark);
  const run::Deblurred deblurred =
      run::deblur(dataset, flags.options, method, output, flags.pictures, device);
  if (deblurred.written == 0) {
    throw DataError(concat(dataset.root.string(), ": method ", method.name,
                           " needs sharp frames at mid-exposure (sharp/, or seen test views), "
                           "found none; use mean"));
  }
  if (deblurred.without_truth > 0) {
    log_warn(concat(deblurred.without_truth, " of ", deblurred.written + deblurred.without_truth,
                    " exposures have no sharp truth and were left out"));
  }
  log_info(concat(deblurred.written, " restored frames in ", output.string()));
  std::cout << (program.json() ? eval::to_json(method.name, deblurred.views)
                               : eval::to_table(deblurred.views));
  return ExitCode::kOk;
}

}  // namespace

int main(int argc, char** argv) {
  apps::Program program("jade_deblur", "Restores blurry frames with their events, without a scene");
  DeblurFlags flags;
  add_flags(program, flags);
  program.add_output_flag(
      "Folder for NAME.png of each exposure, and pictures of its events and restorations in "
      "events/, edi/, efnet/, difference/, alpha/, oracle/, better/");
  program.add_device_flag();
  program.add_json_flag();
  return program.run(argc, argv, [&] { return deblur(flags, program); });
}
