// SPDX-License-Identifier: Apache-2.0
// Expands overrides x scenes x seeds to runs, and checks them before the first one starts.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "jade/config/config.h"
#include "jade/sweep/spec.h"

namespace jade::sweep {

/// Missing data or a missing file that a run needs.
struct Missing {
  std::string key;      ///< that names it
  std::string problem;  ///< "expected DIR, which is not there"
};

/// A run's settings, resolved by the training program.
struct Resolved {
  std::string yaml;                                         ///< complete; parses to the same
                                                            ///< settings
  std::vector<std::pair<std::string, std::string>> values;  ///< key and value of every setting
  std::vector<Missing> missing;
  /// Why individually valid settings contradict each other; empty: they do not. Names keys, no
  /// file.
  std::string conflict;
};

/// The key that names a scene's data set.
inline constexpr const char* kDatasetKey = "dataset.path";

/// Applies the layers in order, later ones override. The training program implements it; this
/// module does not know the settings.
/// @throws ConfigError, one line per setting that cannot be read, with its file or override.
using Resolver = std::function<Resolved(const std::vector<config::Sources>& layers)>;

struct Run {
  std::string row, scene;
  int64_t seed = 0;
  Resolved settings;
  std::string id() const { return concat_id(row, scene, seed); }
  static std::string concat_id(const std::string& row, const std::string& scene, int64_t seed);
  /// The value of a key, empty if there is none.
  std::string value(const std::string& key) const;
};

/// Settings that the command line adds to a sweep file.
struct PlanOptions {
  std::vector<std::filesystem::path> base;  ///< applied below every scene; alone it is the scene
  std::vector<std::string> overrides;       ///< override everything else
  std::map<std::string, std::string> data;  ///< scene name to its data set's folder
  std::vector<std::string> rows, scenes;    ///< only these; empty: all
  std::vector<int64_t> seeds;               ///< replace the sweep's
  bool skip_missing = false;                ///< skip runs that lack data or files
};

struct Plan {
  Spec spec;              ///< rows and scenes as selected
  std::vector<Run> runs;  ///< sorted by seed, then scene, so that rows can be compared early
  std::vector<std::string> skipped;  ///< "ID: what is missing", with skip_missing
  std::set<std::string> whole;       ///< ids of all runs of the sweep, selected or not
};

/// @throws ConfigError with every problem of every run, without duplicates.
Plan make_plan(Spec spec, const PlanOptions& options, const Resolver& resolve);

}  // namespace jade::sweep
