// SPDX-License-Identifier: Apache-2.0
#include "common/cli.h"
#include "jade/core/atomic_file.h"
#include "jade/core/device.h"
#include "jade/core/log.h"
#include "jade/train/options.h"

using namespace jade;

int main(int argc, char** argv) {
  apps::Program program("jade_train",
                        "Trains a sharp 3D Gaussian scene from blurry frames and events");
  program.add_config_flags();
  program.add_output_flag("Run directory");
  program.add_device_flag();
  program.add_seed_flag();
  return program.run(argc, argv, [&] {
    const auto options = program.load_options<train::RunOptions>();
    if (!options) return ExitCode::kOk;
    const torch::Device device = select_device(options->device);
    log_info(concat("device: ", device_name(device)));
    if (program.output().empty())
      throw ConfigError("--output: expected a run directory, found nothing");
    make_writable_folder(program.output());
    return ExitCode::kOk;
  });
}
