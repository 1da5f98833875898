// SPDX-License-Identifier: Apache-2.0
#include "jade/run/prepare.h"

#include <cmath>
#include <functional>
#include <future>
#include <utility>

#include "jade/config/config.h"
#include "jade/core/atomic_file.h"
#include "jade/core/device.h"
#include "jade/core/error.h"
#include "jade/core/log.h"
#include "jade/data/pattern_estimate.h"
#include "jade/run/resume.h"
#include "jade/run/thresholds.h"
#include "jade/train/memory_plan.h"
#include "jade/train/plan.h"

namespace jade::run {
namespace {

/// Replaces pattern.learn auto by on or off.
void settle_pattern(const data::Dataset& dataset, train::LearnPattern& learn) {
  if (learn != train::LearnPattern::kAuto) return;
  const data::PatternEstimate found = data::estimate_pattern(dataset);
  learn = found.is_worth_learning() ? train::LearnPattern::kOn : train::LearnPattern::kOff;
  if (learn == train::LearnPattern::kOn) {
    log_info(concat("pattern     ", std::round(1e4 * found.strength) / 100,
                    " % of white (standard deviation) is the same in all frames and becomes no "
                    "scene; --set pattern.learn=off leaves it"));
  }
}

/// Settles the options of a new run that depend on its data.
void settle_new(const std::optional<Choices>& choices, int64_t budget, Prepared& run) {
  train::RunOptions& options = run.options;
  const data::Dataset& dataset = run.data.dataset;
  options.splat.near_plane = train::near_plane(options.splat, dataset);
  settle_pattern(dataset, options.pattern.learn);
  options.gains.optimize = train::learns_gains(options.gains, dataset) ? train::LearnGains::kOn
                                                                       : train::LearnGains::kOff;
  options.densify.max_gaussians = train::max_gaussians(options, dataset, budget);
  if (choices) {
    // A graph must not be recorded beside the loading of kernels.
    if (choices->minutes > 0 && run.data.kernels.valid()) run.data.kernels.wait();
    choose_pace(dataset, *choices, run.device, options, run.data.restorer);
  }
  if (!train::needs_efnet(options)) run.data.restorer_sha256.clear();
}

}  // namespace

std::string resolved_yaml(train::RunOptions options) {
  return config::to_yaml(fields_of(options), "Resolved configuration of this run");
}

Prepared prepare(const train::RunOptions& given, const std::filesystem::path& folder,
                 const std::string& from, const std::optional<Choices>& choices) {
  const StageTimes times;
  // Report a missing GPU before minutes of loading.
  if (given.device != "auto") select_device(given.device);
  Prepared run{times, given, torch::kCPU, RunDirectory(folder), {}, {}, {}, {}};
  train::RunOptions& options = run.options;
  run.data = load_data(run.directory, options, from.empty());
  run.device = run.data.device;
  const data::Dataset& dataset = run.data.dataset;
  run.stream = std::make_unique<train::StreamScope>(run.device);
  run.times.end("data");
  limit_threads_beside(run.device);
  train::settle(options);
  train::apply_dataset(dataset, options);
  const int64_t budget = train::memory_budget(options, run.device);
  std::optional<train::TrainState> state;
  if (!from.empty()) state = resume(run.directory, from, run.data, choices, run.device, options);
  // Configured thresholds are only compared with measured ones, while the exposures are restored.
  std::future<data::ThresholdEstimate> measured;
  if (!state) {
    const std::string& fingerprint = run.data.fingerprint;
    if (options.events.threshold_positive.is_auto()) {
      settle_thresholds(dataset, measure_thresholds(dataset, fingerprint, 0, options.cache),
                        options);
    } else {
      measured = std::async(std::launch::async, measure_quietly, std::cref(dataset), fingerprint,
                            /*log_offset=*/0, options.cache);
    }
    settle_new(choices, budget, run);
  }
  // On a GPU events are summed and the cache is read while the scene starts.
  const int64_t expected_gaussians =
      state ? train::most_gaussians(*state, options) : int64_t{options.densify.max_gaussians};
  const train::MemoryPlan expected = train::memory_plan(options, dataset, expected_gaussians);
  auto restoring =
      std::make_unique<train::Restoring>(dataset, options, run.device, std::move(run.data.restorer),
                                         train::constants_budget(expected, budget));
  run.state = state ? std::move(*state) : train::make_state(options, dataset, run.device);
  announce(run.data, run.device, run.state, options);
  write_file(run.directory.path() / "config.yaml", resolved_yaml(options));
  write_file(run.directory.path() / kEnvironmentFile,
             environment_json(run.data, run.device, options.seed));
  run.times.end("start");
  const int64_t most = train::most_gaussians(run.state, options);
  train::MemoryPlan plan = train::memory_plan(options, dataset, most);
  run.feed = train::StepFeed(dataset, options, run.device, std::move(restoring),
                             train::constants_budget(plan, budget));
  if (measured.valid()) settle_thresholds(dataset, measured.get(), options);
  if (run.data.kernels.valid()) run.data.kernels.wait();  // a graph must not be recorded beside it
  run.times.end("restorations");
  if (run.device.is_cuda()) {
    plan.constants = run.feed.bank().bytes_on_device();
    log_info(concat("memory      of ", budget >> 20, " MiB for tensors ",
                    train::text_of(plan, run.feed.bank().size(), most), "; peak so far ",
                    peak_memory_bytes(run.device) >> 20, " MiB"));
  }
  return run;
}

}  // namespace jade::run
