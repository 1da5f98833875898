// SPDX-License-Identifier: Apache-2.0
#include "quality.h"

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>

#include "curve.h"
#include "jade/core/atomic_file.h"
#include "jade/core/error.h"

namespace jade::bench {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

/// A run's evaluations in the order of its steps.
struct RunCurve {
  fs::path folder;
  std::vector<Milestone> milestones;
};

Json object_of(const std::string& text) {
  Json json = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  return json.is_object() ? json : Json::object();
}

/// Intermediate evaluations from metrics.jsonl, and the final one from eval.json.
/// @throws DataError if no line has a time, as in runs of older programs
RunCurve read_curve(const fs::path& folder) {
  RunCurve curve{folder, {}};
  std::ifstream in(folder / "metrics.jsonl");
  Json last;
  for (std::string text; std::getline(in, text);) {
    const Json line = object_of(text);
    if (!line.contains("step") || !line.contains("seconds")) continue;
    last = line;
    if (line.contains("test_psnr")) {
      curve.milestones.push_back({line["step"], line["seconds"], line["test_psnr"]});
    }
  }
  if (last.is_null()) {
    throw DataError(concat((folder / "metrics.jsonl").string(),
                           ": expected lines with \"seconds\", found none; train again with this "
                           "version of jade_train"));
  }
  if (fs::exists(folder / "eval.json")) {
    const Json mean = object_of(read_file(folder / "eval.json")).value("mean", Json::object());
    if (mean.contains("psnr") && mean["psnr"].is_number()) {
      curve.milestones.push_back({last["step"], last["seconds"], mean["psnr"]});
    }
  }
  if (curve.milestones.empty()) {
    throw DataError(concat(folder.string(),
                           ": expected evaluations of sharp test views, found none; set "
                           "train.evaluate_every, or let the run end"));
  }
  return curve;
}

/// The run directories in and below a folder, by path.
/// @throws DataError if there is none
std::vector<fs::path> runs_in(const fs::path& folder) {
  std::vector<fs::path> found;
  if (fs::exists(folder / "metrics.jsonl")) return {folder};
  if (fs::is_directory(folder)) {
    for (const auto& entry : fs::recursive_directory_iterator(folder)) {
      if (entry.path().filename() == "metrics.jsonl") found.push_back(entry.path().parent_path());
    }
  }
  if (found.empty()) {
    throw DataError(concat(folder.string(),
                           ": expected a run of jade_train (metrics.jsonl) or a folder of such, "
                           "found none"));
  }
  std::sort(found.begin(), found.end());
  return found;
}

/// Groups runs that differ only in their seed: those of one folder whose names are numbers.
std::string group_of(const fs::path& run) {
  const std::string name = run.filename().string();
  const bool is_seed = !name.empty() && name.find_first_not_of("0123456789") == std::string::npos;
  return (is_seed ? run.parent_path() : run).string();
}

/// Mean over the runs of a group that reached a goal.
struct Mean {
  int64_t runs = 0, reached = 0;
  double seconds = 0, steps = 0, psnr = 0;

  void add(const Milestone* at) {
    ++runs;
    if (at == nullptr) return;
    ++reached;
    seconds += at->seconds;
    steps += static_cast<double>(at->step);
    psnr += at->psnr;
  }
  Json json() const {
    if (reached == 0) return {{"runs", runs}, {"reached", 0}};
    const auto count = static_cast<double>(reached);
    return {{"runs", runs},
            {"reached", reached},
            {"seconds", seconds / count},
            {"step", steps / count},
            {"psnr", psnr / count}};
  }
};

Json summary_of(const std::vector<RunCurve>& curves, const std::vector<double>& goals) {
  std::map<std::string, std::vector<const RunCurve*>> groups;
  for (const RunCurve& curve : curves) groups[group_of(curve.folder)].push_back(&curve);
  Json all = Json::array();
  for (const auto& [name, members] : groups) {
    Json group{{"run", name}, {"goals", Json::array()}};
    for (const double goal : goals) {
      Mean mean;
      for (const RunCurve* each : members) mean.add(reached(each->milestones, goal));
      Json line = mean.json();
      line["goal"] = goal;
      group["goals"].push_back(line);
    }
    Mean end;
    for (const RunCurve* each : members) end.add(&each->milestones.back());
    group["end"] = end.json();
    all.push_back(group);
  }
  return all;
}

/// One line per run and goal, and one for its end, whose goal is empty.
std::string csv_of(const std::vector<RunCurve>& curves, const std::vector<double>& goals) {
  std::string text = "run,goal,seconds,step,psnr\n";
  const auto add = [&](const RunCurve& curve, const std::string& goal, const Milestone* at) {
    char numbers[80] = ",,";
    if (at != nullptr) {
      std::snprintf(numbers, sizeof numbers, "%.3f,%ld,%.3f", at->seconds,
                    static_cast<long>(at->step), at->psnr);
    }
    text += concat(curve.folder.string(), ",", goal, ",", numbers, "\n");
  };
  for (const RunCurve& curve : curves) {
    for (const double goal : goals) add(curve, concat(goal), reached(curve.milestones, goal));
    add(curve, "", &curve.milestones.back());
  }
  return text;
}

/// Seconds (steps), with the number of runs if not all have reached the goal.
std::string cell_of(const Json& mean) {
  if (mean["reached"] == 0) return "-";
  char text[80];
  std::snprintf(text, sizeof text, "%.1f s (%.0f)", mean["seconds"].get<double>(),
                mean["step"].get<double>());
  if (mean["reached"] == mean["runs"]) return text;
  return concat(text, " in ", mean["reached"].get<int64_t>(), " of ", mean["runs"].get<int64_t>());
}

void print(const Json& groups) {
  for (const Json& group : groups) {
    const Json& end = group["end"];
    std::printf("%s, %ld runs\n", group["run"].get<std::string>().c_str(), end["runs"].get<long>());
    for (const Json& goal : group["goals"]) {
      std::printf("  %.2f dB: %s\n", goal["goal"].get<double>(), cell_of(goal).c_str());
    }
    std::printf("  end: %s, %.2f dB\n", cell_of(end).c_str(), end["psnr"].get<double>());
  }
}

}  // namespace

CLI::App* QualityBench::add_to(apps::Program& program) {
  CLI::App* const command = program.cli().add_subcommand(
      "quality",
      "When runs of jade_train first reached --psnr, from their metrics.jsonl: seconds from the "
      "program's start without evaluations on the way. Runs whose folders are seeds (ROW/SCENE/0, "
      "ROW/SCENE/1, as jade_sweep makes them) are averaged");
  command->fallthrough();
  command->add_option("runs", runs, "Run directories, or folders that hold some")
      ->type_name("DIR")
      ->group("Input")
      ->required();
  command->add_option("--psnr", goals, "Goals in dB, such as 28,30")
      ->type_name("LIST")
      ->delimiter(',');
  command->add_option("--csv", csv, "Write a line for every run and goal into this file")
      ->type_name("FILE")
      ->group("Output");
  return command;
}

ExitCode QualityBench::run(const apps::Program& program) const {
  std::vector<RunCurve> curves;
  for (const fs::path& folder : runs) {
    for (const fs::path& each : runs_in(folder)) curves.push_back(read_curve(each));
  }
  const Json groups = summary_of(curves, goals);
  if (!csv.empty()) write_file(csv, csv_of(curves, goals));
  if (program.json()) {
    std::cout << groups.dump(2) << '\n';
  } else {
    print(groups);
  }
  return ExitCode::kOk;
}

}  // namespace jade::bench
