// SPDX-License-Identifier: Apache-2.0
// Overrides x scenes x seeds, expanded to runs and checked before the first one starts.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "jade/config/config.h"
#include "jade/sweep/spec.h"

namespace jade::sweep {

/// Data or a file that a run needs and that is not there.
struct Missing {
  std::string key;      ///< that names it
  std::string problem;  ///< "expected DIR, which is not there"
};

/// A run's settings as the training program understands them.
struct Resolved {
  std::string yaml;                                         ///< complete, reads back the same
  std::vector<std::pair<std::string, std::string>> values;  ///< key and value of every setting
  std::vector<Missing> missing;
  /// Why settings that are right by themselves do not go together; empty: they do. It names keys,
  /// no file.
  std::string conflict;
};

/// The key that names a scene's data set.
inline constexpr const char* kDatasetKey = "dataset.path";

/// Applies the layers in order, later wins. The program that trains knows the settings; this
/// module does not. @throws ConfigError, a line for each setting that cannot be read, with the file
/// or the override that it stands in.
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
  std::vector<std::filesystem::path> base;  ///< laid below every scene; alone it is the scene
  std::vector<std::string> overrides;       ///< win over everything
  std::map<std::string, std::string> data;  ///< scene name to its data set's folder
  std::vector<std::string> rows, scenes;    ///< only these; empty: all
  std::vector<int64_t> seeds;               ///< instead of the sweep's
  bool skip_missing = false;                ///< leave out what lacks data or files
};

struct Plan {
  Spec spec;              ///< rows and scenes as selected
  std::vector<Run> runs;  ///< seed by seed, in it scene by scene, so that rows compare early
  std::vector<std::string> skipped;  ///< "ID: what is missing", with skip_missing
};

/// @throws ConfigError with every problem of every run, each told once.
Plan make_plan(Spec spec, const PlanOptions& options, const Resolver& resolve);

}  // namespace jade::sweep
