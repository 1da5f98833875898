// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <future>
#include <string>

#include "jade/data/exposure.h"
#include "jade/restore/efnet.h"
#include "jade/run/run_directory.h"
#include "jade/train/options.h"
#include "jade/train/state.h"

namespace jade::run {

/// Training data of a run.
struct RunData {
  data::Dataset dataset;
  std::string fingerprint;                  ///< of all training data, see data_fingerprint()
  std::string restorer_sha256;              ///< empty if no restorer is needed
  torch::Device device = torch::kCPU;       ///< that options.device chooses
  std::future<restore::Restorer> restorer;  ///< being loaded, if it runs on a GPU
  std::future<void> kernels;                ///< being loaded, if the device is a GPU
};

/// Reads the data set, starts the device meanwhile, and starts the log file of the run.
/// @throws DataError if a new run's folder contains a run, and for a data set that cannot be
///   trained on; as select_device().
RunData load_data(const RunDirectory& directory, const train::RunOptions& options, bool is_new);

/// Logs what the run begins with: device, data, scene and budget.
void announce(const RunData& data, torch::Device device, const train::TrainState& state,
              const train::RunOptions& options);

/// Content of env.json: program, machine, data and the frames that are trained on.
std::string environment_json(const RunData& data, torch::Device device, int64_t seed);

}  // namespace jade::run
