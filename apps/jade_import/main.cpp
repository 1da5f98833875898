// SPDX-License-Identifier: Apache-2.0
// Converts a recording of an event camera to a data set with poses and a scene.yaml.
#include "common/cli.h"
#include "common/shell.h"
#include "jade/import/importer.h"

using namespace jade;

namespace {

/// @return --offset-ms: if given, even as the default, the offset is not estimated
CLI::Option* add_flags(apps::Program& program, import::StageRange& range) {
  program.add_config_flags();
  program.begin_group("Input");
  program.add_key_flag("recording", "recording", "The recording, a file or a folder")
      ->type_name("PATH");
  program.add_key_flag("--frames", "frames", "Folder of frames, a TIFF of pages, or a video")
      ->type_name("PATH");
  program
      .add_key_flag("--events-group", "events_group",
                    "Group or data set to read from an HDF5 file with several event streams")
      ->type_name("NAME");
  program
      .add_key_flag("--topic", "topic",
                    "Topic (ROS) or camera (AEDAT4) of the events, if a file has several")
      ->type_name("NAME");
  program
      .add_key_flag("--frames-topic", "frames_topic",
                    "Topic (ROS) or camera (AEDAT4) of the frames, if a file has several")
      ->type_name("NAME");
  program
      .add_key_flag(
          "--calibration", "lens.calibration",
          "Calibration by Kalibr, OpenCV, ROS, DV, basalt or RPG; without one, the focal length "
          "is estimated and the lens taken for a pinhole")
      ->type_name("FILE");
  program.add_mask_flag("lens.mask");
  program
      .add_key_flag("--plane-depth", "lens.plane_depth",
                    "With two cameras: depth at which events and frames are aligned exactly")
      ->type_name("X");
  program.begin_group("Time");
  program
      .add_key_flag("--frame-times", "time.frame_times",
                    "File with the start and end of every exposure, or one time per frame")
      ->type_name("FILE");
  program
      .add_key_flag("--exposure-ms", "time.exposure_ms",
                    "Length of the exposures where no file gives it, or auto: estimated")
      ->type_name("MS");
  program
      .add_key_flag("--stamp", "time.stamp",
                    "Instant of the exposure that a single time per frame marks: start, middle or "
                    "end")
      ->type_name("WORD");
  program
      .add_key_flag("--trigger-level", "time.trigger_level",
                    "Level of the trigger input during an exposure: high or low")
      ->type_name("WORD");
  program
      .add_key_flag("--begin-s", "time.begin_s",
                    "Skip everything before this time, in seconds since the first frame")
      ->type_name("S");
  program
      .add_key_flag("--end-s", "time.end_s",
                    "Skip everything after this time, in seconds since the first frame")
      ->type_name("S");
  CLI::Option* const offset = program.add_key_flag(
      "--offset-ms", "time.offset_ms",
      "Clock of the events minus clock of the frames; estimated unless it is given");
  offset->type_name("MS");
  program.begin_group("Scene");
  program
      .add_key_list_flag("--test", "test.names",
                         "Names of the frames that test the scene, as a YAML list: [a, b]")
      ->type_name("NAMES");
  program.add_restoration_flags();
  program.begin_group("Stages");
  program.cli()
      .add_option("--from", range.from,
                  "Repeat this stage and those after it: read, time, sensor, "
                  "undistort, restore, poses, vignetting or write")
      ->type_name("STAGE");
  program.cli().add_option("--until", range.until, "Stop after this stage")->type_name("STAGE");
  return offset;
}

}  // namespace

int main(int argc, char** argv) {
  apps::Program program("jade_import",
                        "Makes a data set with poses from a recording of an event camera");
  program.add_example("jade_import table.aedat4 --calibration camera.yaml --output data/table");
  program.add_example("jade_import table.bag --topic /dvs/events --output data/table");
  import::StageRange range;
  const CLI::Option* const offset = add_flags(program, range);
  program.add_output_flag("Folder of the data set; the results of the stages are kept in import/");
  program.add_device_flag();
  return program.run(argc, argv, [&] {
    auto options = program.load_options<import::ImportOptions>();
    if (!options) return ExitCode::kOk;
    if (options->recording.empty()) {
      throw ConfigError("expected a recording, a file or a folder, found none; name it first");
    }
    if (program.output().empty()) {
      throw ConfigError(
          "--output: expected a folder for the data set, found nothing; add --output data/NAME");
    }
    if (offset->count() > 0) options->time.find_offset = false;
    import::import_recording(*options, program.output(), range);
    if (range.until.empty()) {
      std::cout << program.command("jade_train") << " --config "
                << apps::shell_word(program.output() / "scene.yaml") << " --output DIR\n";
    }
    return ExitCode::kOk;
  });
}
