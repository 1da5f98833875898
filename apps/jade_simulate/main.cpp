// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <iomanip>
#include <iostream>
#include <nlohmann/json.hpp>

#include "common/cli.h"
#include "jade/core/atomic_file.h"
#include "jade/core/folder_lock.h"
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

namespace fs = std::filesystem;

using Names = std::vector<const char*>;

/// Names of the files and folders of data sets and recordings.
const Names kWritten{"images_1",
                     "sharp",
                     "held_out.txt",
                     "gains.csv",
                     "points.npz",
                     "ev_map.npz",
                     "events.h5",
                     "poses_bounds.npy",
                     "all_poses_bounds.npy",
                     "all_timestamps.npy",
                     "images",
                     "images.txt",
                     "exposures.csv",
                     "calib.txt",
                     "events.txt",
                     "calibration.yaml",
                     "camchain.yaml",
                     "truth",
                     "simulation.yaml"};
const Names kFootage{"footage.npy"};

/// The folder of the results. Other runs cannot use it during the object's lifetime; a new folder
/// without results is removed.
class Output {
 public:
  /// @param names  of the results, which replace those of an earlier run
  /// @param force  the folder may have files
  /// @throws ConfigError for a folder with files, DataError if another run is at work there.
  Output(fs::path folder, Names names, bool force)
      : folder_(std::move(folder)), names_(std::move(names)), force_(force) {
    check();
    is_new_ = !fs::exists(folder_);
    make_writable_folder(folder_);
    lock_ = FolderLock::take(folder_);
    if (!lock_) {
      throw DataError(concat(folder_.string(),
                             ": another jade_simulate is at work here; wait for it or choose "
                             "another --output"));
    }
    check();  // a run may have ended since
  }
  ~Output() {
    std::error_code ignored;
    if (lock_) fs::remove(folder_ / ".lock", ignored);
    if (lock_ && is_new_) fs::remove(folder_, ignored);  // does not remove a folder with content
  }
  Output(const Output&) = delete;
  Output& operator=(const Output&) = delete;

  /// Calls `write` with an empty folder, then puts its content into this one. A data set truncated
  /// by a full disk would be read as a smaller one.
  template <class Write>
  void fill(const Write& write) {
    AtomicFolder whole(folder_);
    write(whole.temporary_path());
    for (const char* name : names_) fs::remove_all(folder_ / name);
    whole.commit();
  }

 private:
  static bool is_hidden(const fs::path& path) { return path.filename().string()[0] == '.'; }
  bool has_files() const {
    if (!fs::is_directory(folder_)) return fs::exists(folder_);
    return !std::all_of(fs::directory_iterator(folder_), fs::directory_iterator(),
                        [](const auto& entry) { return is_hidden(entry.path()); });
  }
  void check() const {
    if (folder_.empty()) {
      throw ConfigError(
          "--output: expected a folder for the data set, found nothing; add --output DIR");
    }
    if (!has_files()) return;
    if (!force_ || !fs::is_directory(folder_)) {
      throw ConfigError(concat("--output: expected a new or empty folder, found files in ",
                               folder_.string(), "; choose another, or add --force"));
    }
    if (names_ == kFootage) return;
    for (const char* made : {"simulation.yaml", "truth/simulation.yaml"}) {
      if (fs::exists(folder_ / made)) return;
    }
    for (const char* name : names_) {
      if (!fs::exists(folder_ / name)) continue;
      throw ConfigError(concat("--force: expected results of jade_simulate to replace, found ",
                               name, " without a simulation.yaml in ", folder_.string(),
                               "; choose another folder, or remove it"));
    }
  }

  fs::path folder_;
  Names names_;
  bool force_ = false, is_new_ = false;
  std::optional<FolderLock> lock_;
};

void report(const simulate::SimulateResult& result, const std::filesystem::path& folder,
            bool json) {
  const auto& c = result.content;
  const nlohmann::json blur = result.blur_px > 0 ? nlohmann::json(result.blur_px) : nullptr;
  if (json) {
    std::cout << nlohmann::json{{"output", folder.string()},
                                {"exposures", c.train.size()},
                                {"test_views", c.test.size()},
                                {"events", c.events.size()},
                                {"frames", result.frames},
                                {"blur_px", blur},
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
            << " blurry frames (mean blur ";
  if (result.blur_px > 0) {
    std::cout << result.blur_px << " px";
  } else {
    std::cout << "not known";
  }
  std::cout << "), " << c.test.size() << " sharp test views, " << grouped(c.events.size())
            << " events from " << grouped(result.frames) << " rendered frames\n";
  const auto& errors = result.pose_errors;
  if (errors.nine.max > 0.01) {
    std::cout << "Written poses are " << errors.mid.rms << " px off at mid-exposure (at most "
              << errors.mid.max << "), " << errors.nine.rms << " px over all nine poses (at most "
              << errors.nine.max << ")\n";
  }
}

void write_footage(const simulate::SimulateRun& run, int64_t frames, const fs::path& name,
                   Output& output) {
  const torch::Tensor footage = simulate::exposure_footage(run, frames);
  output.fill([&](const fs::path& folder) { io::write_npy(folder / "footage.npy", footage); });
  std::cout << (name / "footage.npy").string() << ": " << footage.size(0) << " exposures of "
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
  program.cli().add_flag("--force", force,
                         "Replace the results of an earlier run in the folder; other files stay");
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
    Output output(program.output(), footage > 0 ? kFootage : kWritten, force);
    if (footage > 0) {
      write_footage(*run, footage, program.output(), output);
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
    const auto write_into = recording ? simulate::write_recording : simulate::write;
    output.fill([&](const fs::path& folder) { write_into(result, *run, folder); });
    report(result, program.output(), program.json());
    return ExitCode::kOk;
  });
}
