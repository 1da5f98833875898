// SPDX-License-Identifier: Apache-2.0
#include <iomanip>
#include <iostream>
#include <nlohmann/json.hpp>

#include "common/cli.h"
#include "jade/core/atomic_file.h"
#include "jade/core/readable.h"
#include "jade/io/npy.h"
#include "jade/simulate/simulator.h"

using namespace jade;

namespace {

/// A preset is the set of defaults that the file and --set then change.
struct CdavisRun : simulate::SimulateRun {
  CdavisRun() { simulate = simulate::preset_options(simulate::Preset::kCdavis); }
};
struct BlenderRun : simulate::SimulateRun {
  BlenderRun() { simulate = simulate::preset_options(simulate::Preset::kBlender); }
};

std::optional<simulate::SimulateRun> load(apps::Program& program) {
  const config::Sources sources{program.config_file(), program.overrides(), program.layers()};
  const auto preset = config::load<simulate::SimulateRun>(sources).simulate.preset;
  if (preset == simulate::Preset::kBlender) {
    return program.load_options<BlenderRun>();
  }
  return program.load_options<CdavisRun>();
}

void check_output(const std::filesystem::path& folder, bool force) {
  if (folder.empty()) {
    throw ConfigError(
        "--output: expected a folder for the data set, found nothing; add --output DIR");
  }
  if (!force && std::filesystem::exists(folder) &&
      (!std::filesystem::is_directory(folder) || !std::filesystem::is_empty(folder))) {
    throw ConfigError(concat("--output: expected a new or empty folder, found files in ",
                             folder.string(), "; choose another, or add --force"));
  }
}

void report(const simulate::SimulateResult& result, const std::filesystem::path& folder,
            bool json) {
  const auto& c = result.content;
  if (json) {
    std::cout << nlohmann::json{{"output", folder.string()},
                                {"exposures", c.train.size()},
                                {"test_views", c.test.size()},
                                {"events", c.events.size()},
                                {"frames", result.frames},
                                {"blur_px", result.blur_px},
                                {"largest_flow_px", result.largest_flow_px},
                                {"pose_error_mid_rms_px", result.pose_errors.mid.rms},
                                {"pose_error_mid_max_px", result.pose_errors.mid.max},
                                {"pose_error_nine_rms_px", result.pose_errors.nine.rms},
                                {"pose_error_nine_max_px", result.pose_errors.nine.max},
                                {"near", c.near},
                                {"far", c.far}}
                     .dump()
              << "\n";
    return;
  }
  std::cout << std::fixed << std::setprecision(2) << folder.string() << ": " << c.train.size()
            << " blurry frames (mean blur " << result.blur_px << " px), " << c.test.size()
            << " sharp test views, " << grouped(c.events.size()) << " events from "
            << grouped(result.frames) << " rendered frames\n";
  const auto& errors = result.pose_errors;
  if (errors.nine.max > 0.01) {
    std::cout << "Written poses are " << errors.mid.rms << " px off at mid-exposure (at most "
              << errors.mid.max << "), " << errors.nine.rms << " px over all nine poses (at most "
              << errors.nine.max << ")\n";
  }
}

/// Writes atomically: a data set truncated by a full disk would be read as a smaller one.
void write(const simulate::SimulateResult& result, const simulate::SimulateRun& run,
           const std::filesystem::path& folder, bool recording) {
  const auto write_into = recording ? simulate::write_recording : simulate::write;
  // the user gave --force
  if (std::filesystem::exists(folder) && !std::filesystem::is_empty(folder)) {
    write_into(result, run, folder);
    return;
  }
  AtomicFolder whole(folder);
  write_into(result, run, whole.temporary_path());
  whole.commit();
}

void write_footage(const simulate::SimulateRun& run, int64_t frames,
                   const std::filesystem::path& folder) {
  const torch::Tensor footage = simulate::exposure_footage(run, frames);
  std::filesystem::create_directories(folder);
  io::write_npy(folder / "footage.npy", footage);
  std::cout << (folder / "footage.npy").string() << ": " << footage.size(0) << " exposures of "
            << frames << " frames\n";
}

}  // namespace

int main(int argc, char** argv) {
  apps::Program program(
      "jade_simulate",
      "Makes a data set of blurry frames and events from a scene, a file of Gaussians "
      "or sharp frames with poses");
  program.add_example("jade_simulate --config configs/simulate/desk.yaml --output data/desk");
  program.add_example("jade_simulate --set simulate.exposures=8 --recording --output data/raw");
  program.add_config_flags();
  program.add_output_flag("Folder of the data set; made if it does not exist");
  program.add_seed_flag();
  program.add_json_flag();
  bool force = false;
  program.begin_group("Output");
  program.cli().add_flag("--force", force, "Write into a folder that already holds files");
  bool recording = false;
  program.cli().add_flag("--recording", recording,
                         "Write a recording without poses, as a camera does, for jade_import; the "
                         "true data set goes to truth/");
  int64_t footage = 0;
  program.cli()
      .add_option(
          "--footage", footage,
          "Write only footage.npy, to train restorers: N sharp frames at equal steps of every "
          "exposure, uint8 [exposures,N,3,H,W]; not with --recording")
      ->type_name("N")
      ->transform(apps::whole_number(1))
      ->check(CLI::Range(2, 1025))
      ->excludes("--recording");
  return program.run(argc, argv, [&] {
    auto run = load(program);
    if (!run) return ExitCode::kOk;
    check_output(program.output(), force);
    if (footage > 0) {
      write_footage(*run, footage, program.output());
      return ExitCode::kOk;
    }
    if (run->simulate.event_camera.is_beside() && !recording) {
      throw ConfigError(
          "simulate.event_camera: expected --recording, as data sets have frames and events of one "
          "camera; add it, then make a data set with jade_import");
    }
    // The true data set beside a recording has exact poses.
    if (recording) run->simulate.poses = {};
    const auto result = simulate::simulate(*run);
    write(result, *run, program.output(), recording);
    report(result, program.output(), program.json());
    return ExitCode::kOk;
  });
}
