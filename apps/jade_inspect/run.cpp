// SPDX-License-Identifier: Apache-2.0
#include "jade_inspect/run.h"

#include <cstdio>
#include <nlohmann/json.hpp>

#include "common/shell.h"
#include "jade/core/error.h"
#include "jade/core/readable.h"
#include "jade/run/run_summary.h"
#include "jade_inspect/scene.h"

namespace jade::apps {
namespace {

namespace fs = std::filesystem;

void print_numbers(const char* title, const nlohmann::json& numbers) {
  if (!numbers.is_object()) return;
  std::string line;
  for (const auto& [name, value] : numbers.items()) {
    if (!value.is_number()) continue;
    line += (line.empty() ? "" : ", ") + name + " " + readable(value.get<double>(), 5);
  }
  std::printf("%-11s %s\n", title, line.c_str());
}

}  // namespace

void inspect_run(const fs::path& folder, const std::string& train_program, bool json) {
  run::RunSummary s = run::summarize_run(folder);
  if (s.step < s.options.train.iterations) {
    s.problems.push_back(concat("stopped at step ", s.step, " of ", s.options.train.iterations,
                                ": go on with ", train_program, " --output ", shell_word(folder),
                                " --resume"));
  }
  const bool routed = s.options.objective.target == losses::Target::kRouted;
  if (json) {
    nlohmann::json allocation;  // null where no target is routed
    if (routed) allocation = word_of(s.options.allocation.kind);
    const nlohmann::json result = {{"run", folder.string()},
                                   {"dataset", s.options.dataset.path.string()},
                                   {"step", s.step},
                                   {"iterations", s.options.train.iterations},
                                   {"target", word_of(s.options.objective.target)},
                                   {"allocation", allocation},
                                   {"metrics", s.metrics},
                                   {"scores", s.scores},
                                   {"gaussians", to_json(s.gaussians)},
                                   {"problems", s.problems}};
    std::printf("%s\n",
                result.dump(2, ' ', false, nlohmann::json::error_handler_t::replace).c_str());
    return;
  }
  std::printf("run         %s, step %ld of %ld\n", folder.c_str(), long(s.step),
              long(s.options.train.iterations));
  std::printf("data set    %s\n", s.options.dataset.path.c_str());
  const std::string source = routed ? concat(", α of ", word_of(s.options.allocation.kind)) : "";
  std::printf("target      %s%s, seed %ld\n", word_of(s.options.objective.target), source.c_str(),
              long(s.options.seed));
  print_numbers("last logged", s.metrics);
  print_numbers("scores", s.scores);
  print_text(s.gaussians);
  std::printf(s.problems.empty() ? "\nNo problems found.\n" : "\n");
  for (const std::string& problem : s.problems) std::printf("problem     %s\n", problem.c_str());
}

}  // namespace jade::apps
