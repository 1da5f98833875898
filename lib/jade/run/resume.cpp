// SPDX-License-Identifier: Apache-2.0
#include "jade/run/resume.h"

#include <algorithm>

#include "jade/config/config.h"
#include "jade/core/log.h"
#include "jade/run/checkpoint.h"

namespace jade::run {
namespace {

namespace fs = std::filesystem;

/// Checkpoints to try, in this order.
std::vector<fs::path> candidates(const RunDirectory& directory, const std::string& choice) {
  if (choice != "latest") {
    if (!fs::is_directory(choice)) return {choice};
    throw ConfigError(concat("--resume: expected a checkpoint, found the folder ", choice,
                             "; name one of its files, or go on with the newest of a run by ",
                             "--output FOLDER --resume alone"));
  }
  std::vector<fs::path> all = list_checkpoints(directory.path());
  if (all.empty() && directory.holds_results()) {
    throw ConfigError(concat(directory.path().string(),
                             ": expected a checkpoint to go on from, found a scene without one; ",
                             "name another --output, or remove the scene to start again"));
  }
  return all;
}

void keep_decisions(const train::RunOptions& saved, const std::optional<Choices>& choices,
                    train::RunOptions& options) {
  const int64_t steps = train::calendar_steps(saved);
  if (options.train.calendar == 0 && steps != train::calendar_steps(options)) {
    options.train.calendar = steps;
    train::settle(options);
    log_info(concat("calendar    stays that of ", steps,
                    " steps, as the run began; a new --output follows that of ",
                    options.train.iterations));
  }
  if (choices) keep_choices(saved, *choices, options);
  if (options.events.threshold_positive.is_auto()) {
    options.events.threshold_positive = saved.events.threshold_positive;
    if (options.events.threshold_negative == 0) {
      options.events.threshold_negative = saved.events.threshold_negative;
    }
  }
  if (options.densify.max_gaussians.is_auto()) {
    options.densify.max_gaussians = saved.densify.max_gaussians;
  }
  if (options.gains.optimize == train::LearnGains::kAuto)
    options.gains.optimize = saved.gains.optimize;
  if (options.pattern.learn == train::LearnPattern::kAuto)
    options.pattern.learn = saved.pattern.learn;
  if (options.splat.near_plane == 0) options.splat.near_plane = saved.splat.near_plane;
}

/// "1500" and "6%" of 25,000 are the same schedule.
bool same_steps(const Field& a, const Field& b) {
  const auto *x = std::get_if<Steps*>(&a.value), *y = std::get_if<Steps*>(&b.value);
  return x && y && int64_t{**x} == int64_t{**y};
}

/// @throws ConfigError naming the settings that differ, but for free ones.
void check_settings(const fs::path& checkpoint, train::RunOptions saved, train::RunOptions now) {
  // Keys that affect when a run stops or what it shows, but not its result at a given step. The
  // contents of the paths are compared instead.
  static const std::vector<std::string> free_keys = {
      "train.iterations", "train.log_every", "train.evaluate_every", "train.picture_every",
      "checkpoint.every", "device",          "train.target_images",  "dataset.path",
      "efnet.path",       "cache.enabled",   "cache.folder",         "poses.test_fit_steps",
      "init.ply",         "memory_gib"};
  train::settle(now);
  const FieldList saved_fields = fields_of(saved), now_fields = fields_of(now);
  const auto before = config::values(saved_fields), after = config::values(now_fields);
  std::vector<std::string> allowed;
  std::string refused;
  for (size_t i = 0; i < before.size(); ++i) {
    const std::string& key = before[i].first;
    if (before[i].second == after[i].second) continue;
    if (same_steps(saved_fields.fields()[i], now_fields.fields()[i])) continue;
    if (key == "train.calendar" && train::calendar_steps(saved) == train::calendar_steps(now))
      continue;
    const std::string line = concat(key, ": ", before[i].second, " -> ", after[i].second);
    if (std::find(free_keys.begin(), free_keys.end(), key) != free_keys.end()) {
      allowed.push_back(line);
    } else {
      refused += (refused.empty() ? "" : "; ") + line;
    }
  }
  if (!refused.empty()) {
    throw ConfigError(concat(checkpoint.string(),
                             ": this run was made with other settings, and changing them on "
                             "resume would mix two runs: ",
                             refused, ". Put them back or start a new --output"));
  }
  for (const std::string& line : allowed) log_info("changed on resume: " + line);
}

/// @throws CheckpointError for a run of other data or with another restorer.
void check_inputs(const fs::path& checkpoint, const CheckpointInfo& info, const RunData& data) {
  if (info.fingerprint != data.fingerprint) {
    throw CheckpointError(concat(
        checkpoint.string(), ": made from other data than ", data.dataset.root.string(),
        "; check dataset.path, dataset.color and whether its frames, cameras, events, masks, "
        "gains.csv or held_out.txt changed, or the images of train.target_images"));
  }
  if (!data.restorer_sha256.empty() && info.restorer_sha256 != data.restorer_sha256) {
    throw CheckpointError(concat(checkpoint.string(), ": expected the restorer with SHA-256 ",
                                 info.restorer_sha256, ", found ", data.restorer_sha256,
                                 "; set efnet.path to the file the run began with or start a new "
                                 "--output"));
  }
}

}  // namespace

train::RunOptions saved_options(const std::string& yaml) {
  train::RunOptions saved = train::printed_options();
  try {
    config::read_text(yaml, "its configuration", fields_of(saved));
  } catch (const ConfigError& error) {
    throw CheckpointError(
        concat("the checkpoint is of another version of this program: ", error.what()));
  }
  train::settle(saved);
  return saved;
}

std::optional<train::TrainState> resume(const RunDirectory& directory, const std::string& choice,
                                        const RunData& data, const std::optional<Choices>& choices,
                                        torch::Device device, train::RunOptions& options) {
  const std::vector<fs::path> files = candidates(directory, choice);
  if (files.empty()) {
    // A run that was killed before its first checkpoint, or the first start by a script.
    log_info(concat(directory.path().string(), ": no checkpoint yet; starting at step 0"));
    return std::nullopt;
  }
  const auto [file, info] = from_newest(files, [](const fs::path& path) {
    return std::pair{path, read_checkpoint_info(path)};
  });
  // Reject an undamaged checkpoint of another run; an older one would be of that run too.
  const train::RunOptions saved = saved_options(info.config);
  keep_decisions(saved, choices, options);
  check_settings(file, saved, options);
  check_inputs(file, info, data);
  train::TrainState state = train::make_state_to_load(options, data.dataset, device);
  load_checkpoint(file, state);
  if (state.step > options.train.iterations) {
    throw ConfigError(concat("train.iterations: expected at least ", state.step,
                             ", the steps that ", file.string(), " has already, found ",
                             options.train.iterations,
                             "; go on from an earlier one with --resume FILE"));
  }
  log_info(concat("resumed from ", file.filename().string(), ", step ", state.step));
  return state;
}

}  // namespace jade::run
