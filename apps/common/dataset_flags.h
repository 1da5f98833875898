// SPDX-License-Identifier: Apache-2.0
// Flags of the programs that read a data set without a configuration file.
#pragma once

#include "common/cli.h"
#include "jade/data/dataset.h"

namespace jade::apps {

/// --kind, --split, --image-folder, --events-file, --events-unit, --time-unit; not the path.
inline void add_dataset_flags(CLI::App& cli, data::DatasetOptions& options) {
  cli.add_option("--kind", options.kind, "auto, evdeblur, diet_gs, colmap or transforms");
  cli.add_option("--split", options.split, "test views: auto, last, every or none");
  cli.add_option("--image-folder", options.image_folder, "folder of the frames in the data set");
  cli.add_option("--events-file", options.events_file, "recording of the events");
  cli.add_option("--events-unit", options.events_unit, "of the events' times: auto, us, ns or s");
  cli.add_option("--time-unit", options.time_unit, "of the frames' times: auto, us, ns or s");
}

}  // namespace jade::apps
