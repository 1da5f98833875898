// SPDX-License-Identifier: Apache-2.0
// Configuration from YAML files and --set overrides, driven by the `describe` function of an
// options struct (core/fields.h). Order, later wins: what the struct holds, the `extends` chain,
// the file, the files laid over it (each after its own chain), --set, short flags.
#pragma once

#include <filesystem>
#include <istream>
#include <set>
#include <string>
#include <vector>

#include "jade/core/fields.h"

namespace jade::config {

/// A flag of a program that stands for a key.
struct KeyFlag {
  std::string text;      ///< as the user wrote it, "--kind colmap"; for messages
  std::string key;       ///< "dataset.kind"
  std::string value;     ///< taken as it is: a path with a colon needs no YAML quotes here
  bool is_list = false;  ///< `value` is YAML: a list, or its only element
};

struct Sources {
  std::filesystem::path file;          ///< Empty: defaults only. "-" or /dev/stdin: standard input.
  std::vector<std::string> overrides;  ///< "route.lr=1e-3", the value typed as YAML; last wins.
  std::vector<std::filesystem::path> layers;  ///< More files, laid over `file` in this order.
  std::vector<KeyFlag> flags = {};            ///< Win over `overrides`.
};

/// Reads `sources` into the fields. All problems are found before the first is thrown.
/// @throws ConfigError: one line a problem, each with file:line:column (or the override), the key,
///   what was expected and what was found; an unknown key comes with the nearest name.
/// Callers pass fields of a fresh struct, so that a failed load changes nothing: see load().
/// @param named  if not null, the keys that any source gives a value are added to it
void read(const Sources& sources, const FieldList& fields, std::set<std::string>* named = nullptr);

/// Computes derived values once all fields are read. An options struct with derived values declares
/// an overload beside it.
template <class Options>
void settle(Options&) {}

/// `options` with `sources` laid over them, settled.
template <class Options>
Options load(const Sources& sources, Options options = {}) {
  read(sources, fields_of(options));
  settle(options);
  return options;
}

/// Reads fields from YAML text, such as a checkpoint's; `name` stands for the file in messages,
/// relative paths start in the current folder.
void read_text(const std::string& yaml, const std::string& name, const FieldList& fields);

/// The resolved configuration as YAML with help, units and ranges as comments. Reading it back and
/// printing again gives the same bytes.
std::string to_yaml(const FieldList& fields, const std::string& title);

/// A JSON Schema (draft 2020-12) of the same fields, for editors.
std::string to_json_schema(const FieldList& fields, const std::string& title);

/// The values alone, "key=value" lines in order; for comparing configurations.
std::vector<std::pair<std::string, std::string>> values(const FieldList& fields);

/// The closest of `words` to `word`, or empty when none is near enough to be a typing mistake.
std::string nearest(const std::string& word, const std::vector<std::string>& words);

}  // namespace jade::config
