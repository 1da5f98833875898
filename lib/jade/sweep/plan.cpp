// SPDX-License-Identifier: Apache-2.0
#include "jade/sweep/plan.h"

#include <algorithm>
#include <set>
#include <sstream>

#include "jade/config/problems.h"
#include "jade/core/error.h"

namespace jade::sweep {
namespace {

namespace fs = std::filesystem;

template <class Entry>
void keep_named(std::vector<Entry>& list, const std::vector<std::string>& names,
                const std::string& flag, config::Problems& problems) {
  if (names.empty()) return;
  std::vector<std::string> known;
  for (const Entry& entry : list) known.push_back(entry.name);
  for (const std::string& name : names) {
    if (std::find(known.begin(), known.end(), name) != known.end()) continue;
    const std::string close = config::nearest(name, known);
    problems.add(concat(flag, ": the sweep has none named ", name,
                        close.empty() ? "" : "; did you mean " + close + "?"));
  }
  list.erase(std::remove_if(list.begin(), list.end(),
                            [&](const Entry& entry) {
                              return std::find(names.begin(), names.end(), entry.name) ==
                                     names.end();
                            }),
             list.end());
}

/// A path as a YAML value, for any characters.
std::string yaml_text(const fs::path& path) {
  std::string out = "'";
  for (const char c : fs::absolute(path).lexically_normal().string()) {
    out += c;
    if (c == '\'') out += c;
  }
  return out + "'";
}

std::vector<config::Sources> layers_of(const Spec& spec, const PlanOptions& options, const Row& row,
                                       const Scene& scene, int64_t seed) {
  std::vector<config::Sources> layers;
  if (!options.base.empty()) layers.push_back({{}, {}, options.base});
  layers.push_back({scene.config, scene.set, {}});
  // After the rows' files: a preset among them sets its own number of steps.
  layers.push_back({{}, {}, row.configs});
  layers.push_back({{}, spec.set, {}});
  layers.push_back({{}, row.set, {}});
  config::Sources last{{}, options.overrides, {}};
  const auto data = options.data.find(scene.name);
  if (data != options.data.end()) {
    last.overrides.push_back(concat(kDatasetKey, "=", yaml_text(data->second)));
  }
  last.overrides.push_back(concat("seed=", seed));
  layers.push_back(last);
  return layers;
}

/// Overrides that the sweep's file gives to all runs, to those of a scene, or to those of a row.
struct FileSet {
  std::string owner;  ///< "scene room: "; empty: all
  const std::vector<std::string>&set, &places;

  std::string where(size_t i) const { return concat(places[i], owner, "set: "); }
};

/// Refuses a seed among settings, which the seed of each run would override.
/// @param where  of an override's number
template <class Where>
void check_seed(const std::vector<std::string>& set, const Where& where,
                config::Problems& problems) {
  for (size_t i = 0; i < set.size(); ++i) {
    if (set[i].substr(0, set[i].find('=')) != "seed") continue;
    problems.add(concat(where(i), "expected no seed, because each run has its own, found ", set[i],
                        "; use seeds: or --seeds"));
  }
}

/// The line with the place and the owner of the file's override that it is about.
std::string placed(const std::string& line, const std::vector<FileSet>& sets) {
  for (const FileSet& each : sets) {
    for (size_t i = 0; i < each.set.size(); ++i) {
      const std::string start = concat("--set ", each.set[i], ": ");
      if (line.rfind(start, 0) == 0)
        return concat(each.where(i), each.set[i], ": ", line.substr(start.size()));
    }
  }
  return line;
}

std::set<std::string> ids_of(const Spec& spec) {
  std::set<std::string> ids;
  for (const Row& row : spec.rows) {
    for (const Scene& scene : spec.scenes) {
      for (const int64_t seed : row.seeds.empty() ? spec.seeds : row.seeds)
        ids.insert(Run::concat_id(row.name, scene.name, seed));
    }
  }
  return ids;
}

/// Schedules of the runs that were added, and whether all settings were read.
struct Added {
  std::set<Schedule> schedules;
  bool all_read = true;
};

void add_run(const Row& row, const Scene& scene, int64_t seed, const PlanOptions& options,
             const Resolver& resolve, Plan& plan, Added& added, config::Problems& problems) {
  Run run{row.name, scene.name, seed, {}};
  try {
    run.settings = resolve(layers_of(plan.spec, options, row, scene, seed));
  } catch (const ConfigError& error) {
    const std::vector<FileSet> sets{
        {concat("row ", row.name, ": "), row.set, row.set_places},
        {concat("scene ", scene.name, ": "), scene.set, scene.set_places},
        {"", plan.spec.set, plan.spec.set_places}};
    std::istringstream lines(error.what());
    for (std::string line; std::getline(lines, line);) problems.add(placed(line, sets));
    added.all_read = false;
    return;
  }
  added.schedules.insert(
      {std::stoll(run.value("train.iterations")), std::stoll(run.value("train.evaluate_every"))});
  if (!run.settings.conflict.empty()) {
    problems.add(concat("row ", row.name, ": ", run.settings.conflict));
    return;
  }
  for (const Missing& missing : run.settings.missing) {
    const bool data = missing.key == kDatasetKey;
    const std::string what = concat(missing.key, ": ", missing.problem);
    const std::string who = data ? "scene " + scene.name : "row " + row.name;
    const std::string how =
        !data ? ""
              : concat("; ", scene.make.empty() ? "" : "make it with " + scene.make + ", or ",
                       "name its folder with --data ", scene.name, "=DIR");
    if (options.skip_missing) {
      plan.skipped.push_back(run.id() + ": " + what);
    } else {
      problems.add(concat(who, ": ", what, how, ", or leave it out with --skip-missing"));
    }
  }
  if (run.settings.missing.empty()) plan.runs.push_back(std::move(run));
}

}  // namespace

std::string Run::concat_id(const std::string& row, const std::string& scene, int64_t seed) {
  return concat(row, "/", scene, "/", seed);
}

std::string Run::value(const std::string& key) const {
  for (const auto& [name, text] : settings.values) {
    if (name == key) return text;
  }
  return "";
}

Plan make_plan(Spec spec, const PlanOptions& options, const Resolver& resolve) {
  Plan plan;
  config::Problems problems;
  if (spec.scenes.empty()) {
    if (options.base.empty())
      throw ConfigError(concat(spec.name, ": names no scenes; add --config scene.yaml"));
    spec.scenes.push_back({options.base.front().stem().string(), {}, {}, ""});
  }
  std::vector<std::string> known;
  for (const Scene& scene : spec.scenes) known.push_back(scene.name);
  for (const auto& data : options.data) {
    if (std::find(known.begin(), known.end(), data.first) == known.end()) {
      const std::string close = config::nearest(data.first, known);
      problems.add(concat("--data ", data.first, ": the sweep has no such scene",
                          close.empty() ? "" : "; did you mean " + close + "?"));
    }
  }
  plan.whole = ids_of(spec);
  keep_named(spec.rows, options.rows, "--rows", problems);
  keep_named(spec.scenes, options.scenes, "--scenes", problems);
  if (!options.seeds.empty()) {
    spec.seeds = options.seeds;
    for (Row& row : spec.rows) row.seeds.clear();
  }
  check_seed(
      options.overrides, [](size_t) { return "--set: "; }, problems);
  std::vector<FileSet> sets{{"", spec.set, spec.set_places}};
  for (const Scene& scene : spec.scenes)
    sets.push_back({concat("scene ", scene.name, ": "), scene.set, scene.set_places});
  for (const Row& row : spec.rows)
    sets.push_back({concat("row ", row.name, ": "), row.set, row.set_places});
  for (const FileSet& each : sets)
    check_seed(
        each.set, [&](size_t i) { return each.where(i); }, problems);
  plan.spec = std::move(spec);
  std::vector<int64_t> seeds = plan.spec.seeds;
  for (const Row& row : plan.spec.rows)
    seeds.insert(seeds.end(), row.seeds.begin(), row.seeds.end());
  Added added;
  std::set<int64_t> done;
  for (const int64_t seed : seeds) {
    if (!done.insert(seed).second) continue;
    for (const Scene& scene : plan.spec.scenes) {
      for (const Row& row : plan.spec.rows) {
        const auto& own = row.seeds.empty() ? plan.spec.seeds : row.seeds;
        if (row.run && std::find(own.begin(), own.end(), seed) != own.end()) {
          add_run(row, scene, seed, options, resolve, plan, added, problems);
        }
      }
    }
  }
  // Rows and scenes that are left out may fill the columns.
  if (added.all_read && !added.schedules.empty() && options.rows.empty() &&
      options.scenes.empty()) {
    for (const Column& column : plan.spec.columns) {
      const std::string problem = empty_column(column, added.schedules);
      if (!problem.empty()) problems.add("columns: " + problem);
    }
  }
  problems.throw_if_any();
  if (plan.runs.empty()) {
    throw ConfigError(concat(plan.spec.name, ": nothing is left to run",
                             plan.skipped.empty() ? "" : ": " + plan.skipped.front()));
  }
  return plan;
}

}  // namespace jade::sweep
