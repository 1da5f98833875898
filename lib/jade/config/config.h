// SPDX-License-Identifier: Apache-2.0
// Reads configurations from YAML files and --set overrides, using the `describe` function of an
// options struct (core/fields.h). Later sources win: the struct's own values, the `extends` chain,
// the file, additional files (each after its own chain), --set, short flags.
#pragma once

#include <filesystem>
#include <istream>
#include <set>
#include <string>
#include <vector>

#include "jade/core/fields.h"

namespace jade::config {

/// A program's flag that sets a key.
struct KeyFlag {
  std::string text;      ///< as the user typed it, "--kind colmap"; for messages
  std::string key;       ///< "dataset.kind"
  std::string value;     ///< used verbatim: a path with a colon needs no YAML quotes
  bool is_list = false;  ///< `value` is YAML: a list, or its only element
};

struct Sources {
  std::filesystem::path file;          ///< Empty: defaults only. "-" or /dev/stdin: standard input.
  std::vector<std::string> overrides;  ///< "route.lr=1e-3", the value parsed as YAML; the last one
                                       ///< wins.
  std::vector<std::filesystem::path> layers;  ///< Additional files, applied after `file` in this
                                              ///< order.
  std::vector<KeyFlag> flags = {};            ///< Override `overrides`.
};

/// Reads `sources` into the fields. Collects all problems before throwing.
/// @throws ConfigError: one line per problem, each with file:line:column (or the override), the
///   key, what was expected and what was found; for an unknown key, the nearest name. Callers pass
///   fields of a fresh struct, so that a failed load changes nothing: see load().
/// @param named  if not null, receives the keys that any source sets
void read(const Sources& sources, const FieldList& fields, std::set<std::string>* named = nullptr);

/// Computes derived values once all fields are read. An options struct with derived values declares
/// an overload beside it.
template <class Options>
void settle(Options&) {}

/// Returns `options` with `sources` applied and derived values computed.
template <class Options>
Options load(const Sources& sources, Options options = {}) {
  read(sources, fields_of(options));
  settle(options);
  return options;
}

/// Reads fields from YAML text, such as a checkpoint's; messages call the file `name`, and relative
/// paths are resolved against the current folder.
void read_text(const std::string& yaml, const std::string& name, const FieldList& fields);

/// The resolved configuration as YAML, with help, units and ranges as comments. Reading and
/// printing it again gives the same bytes.
std::string to_yaml(const FieldList& fields, const std::string& title);

/// A JSON Schema (draft 2020-12) of the same fields, for editors.
std::string to_json_schema(const FieldList& fields, const std::string& title);

/// The values as "key=value" pairs in order, for comparing configurations.
std::vector<std::pair<std::string, std::string>> values(const FieldList& fields);

/// The closest of `words` to `word`, or empty if none is close enough to be a typing mistake.
std::string nearest(const std::string& word, const std::vector<std::string>& words);

}  // namespace jade::config
