// SPDX-License-Identifier: Apache-2.0
#include "run.h"

#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>

#include "jade/config/config.h"
#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/gaussians/ply.h"
#include "jade/run/checkpoint.h"
#include "jade/train/options.h"
#include "ply.h"

namespace jade::apps {
namespace {

namespace fs = std::filesystem;

struct RunSummary {
  train::RunOptions options;
  int64_t step = 0;        ///< of the newest whole checkpoint
  nlohmann::json metrics;  ///< the last line of metrics.jsonl, or null
  nlohmann::json scores;   ///< the means of eval.json, or null
  GaussianSummary gaussians;
  std::vector<std::string> problems;
};

/// The last line that is an object; counts those that are none.
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
                                  " is no number; see train.log, and resume from an older "
                                  "checkpoint"));
    }
  }
}

void read_checkpoints(const fs::path& run, RunSummary& s) {
  const auto checkpoints = run::list_checkpoints(run);
  splat::Gaussians gaussians;
  bool found = false;
  for (const fs::path& path : checkpoints) {
    try {
      gaussians = run::load_checkpoint_gaussians(path);
      s.step = std::stoll(path.stem().string().substr(5));
      found = true;
      break;
    } catch (const CheckpointError& problem) {
      s.problems.emplace_back(problem.what());
    }
  }
  if (!found) {
    s.problems.push_back(
        concat(run.string(), ": no whole checkpoint; it cannot be resumed, train again"));
  }
  const fs::path ply = run / "point_cloud.ply";
  if (fs::exists(ply)) {
    gaussians = gaussians::read_ply(ply).gaussians;
    found = true;
  }
  if (found) s.gaussians = summarize(gaussians);
  s.problems.insert(s.problems.end(), s.gaussians.problems.begin(), s.gaussians.problems.end());
}

RunSummary summarize_run(const fs::path& run) {
  RunSummary s;
  s.options = config::load<train::RunOptions>({run / "config.yaml", {}, {}});
  read_metrics(run, s);
  read_checkpoints(run, s);
  if (fs::exists(run / "eval.json")) {
    const auto eval = nlohmann::json::parse(read_file(run / "eval.json"), nullptr, false);
    if (eval.is_object() && eval.contains("mean")) {
      s.scores = eval["mean"];
    } else {
      s.problems.push_back(
          concat((run / "eval.json").string(), ": damaged; make it again with jade_eval --run"));
    }
  }
  if (s.step < s.options.train.iterations) {
    s.problems.push_back(concat("stopped at step ", s.step, " of ", s.options.train.iterations,
                                ": go on with jade_train --config ", (run / "config.yaml").string(),
                                " --output ", run.string(), " --resume"));
  }
  if (!fs::is_directory(s.options.dataset.path)) {
    s.problems.push_back(concat("its data set ", s.options.dataset.path.string(),
                                " is gone: jade_eval and --resume need it; set dataset.path"));
  }
  return s;
}

void print_numbers(const char* title, const nlohmann::json& numbers) {
  if (!numbers.is_object()) return;
  std::string line;
  for (const auto& [name, value] : numbers.items()) {
    if (!value.is_number()) continue;
    char number[40];
    std::snprintf(number, sizeof number, "%.5g", value.get<double>());
    line += (line.empty() ? "" : ", ") + name + " " + number;
  }
  std::printf("%-11s %s\n", title, line.c_str());
}

}  // namespace

bool is_run(const fs::path& folder) {
  return fs::exists(folder / "config.yaml") &&
         (fs::exists(folder / "checkpoints") || fs::exists(folder / "metrics.jsonl") ||
          fs::exists(folder / "train.log"));
}

void inspect_run(const fs::path& folder, bool json) {
  const RunSummary s = summarize_run(folder);
  if (json) {
    const nlohmann::json result = {{"run", folder.string()},
                                   {"dataset", s.options.dataset.path.string()},
                                   {"step", s.step},
                                   {"iterations", s.options.train.iterations},
                                   {"target", word_of(s.options.objective.target)},
                                   {"allocation", word_of(s.options.allocation.kind)},
                                   {"metrics", s.metrics},
                                   {"scores", s.scores},
                                   {"gaussians", to_json(s.gaussians)},
                                   {"problems", s.problems}};
    std::printf("%s\n", result.dump(2).c_str());
    return;
  }
  std::printf("run         %s, step %ld of %ld\n", folder.c_str(), long(s.step),
              long(s.options.train.iterations));
  std::printf("data set    %s\n", s.options.dataset.path.c_str());
  std::printf("target      %s, allocation %s, seed %ld\n", word_of(s.options.objective.target),
              word_of(s.options.allocation.kind), long(s.options.seed));
  print_numbers("last logged", s.metrics);
  print_numbers("scores", s.scores);
  print_text(s.gaussians);
  std::printf(s.problems.empty() ? "\nNo problems found.\n" : "\n");
  for (const std::string& problem : s.problems) std::printf("problem     %s\n", problem.c_str());
}

}  // namespace jade::apps
