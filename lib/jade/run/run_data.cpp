// SPDX-License-Identifier: Apache-2.0
#include "jade/run/run_data.h"

#include <functional>
#include <nlohmann/json.hpp>
#include <utility>

#include "jade/core/device.h"
#include "jade/core/log.h"
#include "jade/core/progress.h"
#include "jade/core/readable.h"
#include "jade/core/version.h"
#include "jade/data/dataset.h"
#include "jade/data/trained_frames.h"
#include "jade/geometry/origin.h"
#include "jade/response/identity_response.h"
#include "jade/run/checkpoint.h"
#include "jade/train/bank.h"

namespace jade::run {
namespace {

/// The device, and what is loaded on a GPU on further threads.
struct StartedDevice {
  torch::Device device;
  std::future<restore::Restorer> restorer;
  std::future<void> kernels;
};

StartedDevice started_device(const train::RunOptions& options, const std::string& restorer_sha256) {
  StartedDevice started{select_device(options.device), {}, {}};
  const torch::Device device = started.device;
  if (!device.is_cuda()) return started;
  if (train::needs_efnet(options) &&
      !restore::restored_before(options.cache, restorer_sha256, device, options.dataset.path)) {
    started.restorer = restore::load_beside(options.efnet, device);
  }
  started.kernels = std::async(std::launch::async, [device] { train::load_kernels(device); });
  return started;
}

}  // namespace

RunData load_data(const RunDirectory& directory, const train::RunOptions& options, bool is_new) {
  if (is_new && directory.holds_a_run()) {
    throw DataError(
        concat(directory.path().string(),
               ": holds a run already; go on with it (--resume) or choose another --output"));
  }
  RunData data;
  // Report wrong paths before minutes of loading.
  data.restorer_sha256 = train::restorer_sha256(options);
  data::kind_of(options.dataset);
  // Set up before anything that may warn.
  set_log_file(directory.path() / "train.log");
  // CUDA takes a tenth of a second or more to find its GPUs.
  std::future<StartedDevice> starting =
      std::async(std::launch::async, started_device, std::cref(options), data.restorer_sha256);
  if (options.response.enabled) response::identity_response();  // fails before the data are read
  log_info(concat("reading     ", options.dataset.path.string()));
  std::vector<std::string> warnings;
  const FewerThreads reading(options.device != "cpu");
  {
    const Progress progress("reading", 1, 0, "data sets");
    data.dataset = data::load_dataset(options.dataset, &warnings);
  }
  if (data.dataset.undistorted && options.objective.target == losses::Target::kImageFolder) {
    warnings.emplace_back(
        "train.target_images: expected images without distortion, as the frames were undistorted "
        "on loading; images that jade_deblur wrote from this data set fit; undistort others first");
  }
  for (const std::string& warning : warnings) log_warn(warning);
  if (data.dataset.train.empty()) {
    throw DataError(concat(data.dataset.root.string(),
                           ": expected at least one training exposure, found none"));
  }
  data.fingerprint =
      data_fingerprint(data.dataset, train::target_images_sha256(data.dataset, options));
  StartedDevice started = starting.get();
  data.device = started.device;
  data.restorer = std::move(started.restorer);
  data.kernels = std::move(started.kernels);
  return data;
}

void announce(const RunData& data, torch::Device device, const train::TrainState& state,
              const train::RunOptions& options) {
  int64_t event_count = 0;
  for (const data::Exposure& exposure : data.dataset.train) event_count += exposure.events.size();
  const auto& camera = data.dataset.train.front().camera;
  log_info(concat("device      ", device_name(device)));
  log_info(concat("data        ", data.dataset.name, " (", word_of(data.dataset.kind),
                  "): ", data.dataset.train.size(), " exposures of ", camera.width, "x",
                  camera.height, data.dataset.monochrome ? ", monochrome, " : " in colour, ",
                  grouped(event_count), " events; ", data.dataset.test.size(),
                  data.dataset.test.size() == 1 ? " sharp test view (" : " sharp test views (",
                  data.dataset.split, ")"));
  for (const std::string& note : data.dataset.notes) log_info("data        " + note);
  log_info(concat("scene       ", grouped(state.gaussians.size()), " Gaussians, extent ",
                  readable(state.gaussians.extent(), 3), ", near plane ",
                  train::render_options(options).near_plane));
  if (state.allocation) {
    int64_t count = 0;
    for (const auto& parameter : state.allocation->parameters()) count += parameter.numel();
    log_info(concat("allocation  ", word_of(options.allocation.kind), ", ", grouped(count),
                    " parameters"));
  } else {
    log_info(concat("target      ", word_of(options.objective.target)));
  }
  if (train::needs_efnet(options))
    log_info(concat("restorer    ", restore::restorer_path(options.efnet).string()));
  log_info(concat("budget      ", grouped(options.train.iterations), " steps, at most ",
                  grouped(int64_t{options.densify.max_gaussians}), " Gaussians, seed ",
                  options.seed));
}

std::string environment_json(const RunData& data, torch::Device device, int64_t seed) {
  nlohmann::ordered_json environment{{"program", "jade_train " + version()},
                                     {"commit", git_commit()},
                                     {"torch", torch_version()},
                                     {"cuda", cuda_version()},
                                     {"device", device_name(device)},
                                     {"seed", seed},
                                     {"data_fingerprint", data.fingerprint}};
  if (!data.restorer_sha256.empty()) environment["restorer_sha256"] = data.restorer_sha256;
  if (!geometry::is_zero(data.dataset.origin)) environment["origin"] = data.dataset.origin;
  const auto list = [&](const char* key, const std::vector<data::TrainedFrame>& frames) {
    environment[key] = nlohmann::ordered_json::array();
    for (const data::TrainedFrame& frame : frames) {
      environment[key].push_back({{"name", frame.name}, {"sha256", frame.sha256}});
    }
  };
  list(kTrainedKey, data::trained_frames(data.dataset));
  list(kTestKey, data::test_views(data.dataset));
  return environment.dump(2) + "\n";
}

}  // namespace jade::run
