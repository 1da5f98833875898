// SPDX-License-Identifier: Apache-2.0
#include "jade/run/run_summary.h"

#include <fstream>

#include "jade/config/config.h"
#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/gaussians/ply.h"
#include "jade/run/checkpoint.h"
#include "jade/run/run_directory.h"

namespace jade::run {
namespace {

namespace fs = std::filesystem;

/// The last line that is a JSON object; counts invalid lines.
nlohmann::json last_metrics(const fs::path& path, int64_t* damaged) {
  nlohmann::json last;
  std::ifstream in(path);
  for (std::string line; std::getline(in, line);) {
    nlohmann::json parsed = nlohmann::json::parse(line, nullptr, false);
    if (parsed.is_object()) {
      last = std::move(parsed);
    } else if (!line.empty()) {
      ++*damaged;
    }
  }
  return last;
}

void read_metrics(const fs::path& run, RunSummary& s) {
  int64_t damaged = 0;
  s.metrics = last_metrics(run / "metrics.jsonl", &damaged);
  if (damaged > 0) {
    s.problems.push_back(concat((run / "metrics.jsonl").string(), ": ", damaged,
                                " lines are no JSON (a killed run?); --resume drops them"));
  }
  if (s.metrics.is_null()) {
    s.problems.push_back("nothing was logged yet: metrics.jsonl is missing or empty");
    return;
  }
  for (const auto& [name, value] : s.metrics.items()) {
    if (value.is_null()) {
      s.problems.push_back(concat("the last logged ", name,
                                  " is no number; see train.log, and train again with smaller "
                                  "step sizes (optim.*) and another --output"));
    }
  }
}

void read_checkpoints(const fs::path& run, RunSummary& s) {
  const auto checkpoints = list_checkpoints(run);
  splat::Gaussians gaussians;
  bool found = false;
  for (const fs::path& path : checkpoints) {
    try {
      gaussians = load_checkpoint_scene(path).gaussians;
      s.step = step_of(path);
      found = true;
      break;
    } catch (const CheckpointError& problem) {
      s.problems.emplace_back(problem.what());
    }
  }
  if (!found) {
    s.problems.push_back(concat(
        run.string(), ": no whole checkpoint; ",
        checkpoints.empty() ? "--resume begins with step 0" : "train again with another --output"));
  }
  const fs::path ply = run / kSceneFile;
  if (fs::exists(ply)) {
    gaussians = gaussians::read_ply(ply).gaussians;
    found = true;
  }
  if (found) s.gaussians = gaussians::summarize(gaussians);
  s.problems.insert(s.problems.end(), s.gaussians.problems.begin(), s.gaussians.problems.end());
}

}  // namespace

bool is_run(const fs::path& folder) {
  std::error_code unreadable;
  const auto has = [&](const char* name) { return fs::exists(folder / name, unreadable); };
  return has("config.yaml") && (has("checkpoints") || has("metrics.jsonl") || has("train.log"));
}

RunSummary summarize_run(const fs::path& run) {
  RunSummary s;
  s.options = config::load({run / "config.yaml", {}, {}}, train::printed_options());
  read_metrics(run, s);
  read_checkpoints(run, s);
  if (fs::exists(run / kScoresFile)) {
    const auto eval = nlohmann::json::parse(read_file(run / kScoresFile), nullptr, false);
    if (eval.is_object() && eval.contains("mean")) {
      s.scores = eval["mean"];
    } else {
      s.problems.push_back(
          concat((run / kScoresFile).string(), ": damaged; make it again with jade_eval --run"));
    }
  }
  if (!fs::is_directory(s.options.dataset.path)) {
    s.problems.push_back(concat("its data set ", s.options.dataset.path.string(),
                                " is gone: jade_eval and --resume need it; set dataset.path"));
  }
  return s;
}

}  // namespace jade::run
