// SPDX-License-Identifier: Apache-2.0
// A recording of an event camera in, a data set with poses and its scene.yaml out.
#include "common/cli.h"
#include "common/shell.h"
#include "jade/import/importer.h"

using namespace jade;

namespace {

/// @return --offset-ms: an offset is not searched once it is given, be it the default
CLI::Option* add_flags(apps::Program& program, import::StageRange& range) {
  program.add_config_flags();
  program.add_key_flag("recording", "recording", "the recording, a file or a folder");
  program.add_key_flag("--frames", "frames", "folder of frames, or a video");
  program.add_key_flag("--events-group", "events_group",
                       "of an HDF5 file with several event streams, the group or data set to read");
  program.add_key_flag("--topic", "topic",
                       "of a ROS bag with several, the topic of events to read");
  program.add_key_flag("--calibration", "lens.calibration",
                       "calibration of Kalibr, OpenCV, ROS, DV or RPG (none: a pinhole, its focal "
                       "length searched)");
  program.add_key_flag("--mask", "lens.mask",
                       "image whose black pixels count in no frame (lens borders, hot areas)");
  program.add_key_flag("--frame-times", "time.frame_times", "list of exposures");
  program.add_key_flag("--exposure-ms", "time.exposure_ms",
                       "length of exposures that no file says; auto: found");
  program.add_key_flag("--stamp", "time.stamp",
                       "what the only time of a frame is: start, middle or end of its exposure");
  program.add_key_flag("--trigger-level", "time.trigger_level",
                       "of the trigger input during an exposure, high or low");
  program.add_key_flag("--begin-s", "time.begin_s",
                       "read from here on, seconds since the first frame");
  program.add_key_flag("--end-s", "time.end_s", "read until here, seconds since the first frame");
  CLI::Option* const offset = program.add_key_flag(
      "--offset-ms", "time.offset_ms",
      "how far the clock of the events is ahead of that of the frames; not searched then");
  program.add_key_flag("--plane-depth", "lens.plane_depth",
                       "of two cameras: where events fall on the frames exactly");
  program.add_key_list_flag("--test", "test.names",
                            "frames that judge the scene, a YAML list: [a, b]");
  program.add_key_flag("--threshold-positive", "events.threshold_positive",
                       "log intensity of one positive event; auto: measured");
  program.add_key_flag("--threshold-negative", "events.threshold_negative",
                       "of one negative event; 0: like the positive one");
  program.add_key_flag("--efnet", "efnet.path",
                       "TorchScript file of the learned restorer (the one that ships)");
  program.cli().add_option("--from", range.from,
                           "make this stage and those after it again: read, pattern, time, sensor, "
                           "undistort, restore, poses, vignetting, write");
  program.cli().add_option("--until", range.until, "stop after this stage");
  return offset;
}

}  // namespace

int main(int argc, char** argv) {
  apps::Program program("jade_import",
                        "Makes a data set with poses from a recording of an event camera");
  import::StageRange range;
  const CLI::Option* const offset = add_flags(program, range);
  program.add_output_flag("folder of the data set; stages are kept in import/");
  program.add_device_flag();
  return program.run(argc, argv, [&] {
    auto options = program.load_options<import::ImportOptions>();
    if (!options) return ExitCode::kOk;
    if (program.output().empty()) {
      throw ConfigError("--output: expected a folder for the data set, found nothing");
    }
    if (offset->count() > 0) options->time.find_offset = false;
    import::import_recording(*options, program.output(), range);
    if (range.until.empty()) {
      std::cout << "jade_train --config " << apps::shell_word(program.output() / "scene.yaml")
                << " --output DIR\n";
    }
    return ExitCode::kOk;
  });
}
