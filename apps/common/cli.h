// SPDX-License-Identifier: Apache-2.0
// Shared by all programs: flags, --version, logging, signals, and the conversion of errors to exit
// codes.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <iostream>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <torch/types.h>
#include <vector>

#include "common/help.h"
#include "jade/config/config.h"
#include "jade/core/error.h"

namespace jade::apps {

/// Validates a flag's whole number, decimal even with leading zeros, which CLI11 reads as octal.
/// @param least  0 or 1
CLI::Validator whole_number(int64_t least);

/// A flag's number from `low` to `high`; rejects NaN, unlike CLI::Range.
CLI::Validator within(double low, double high);

/// `file`, or, if that relative path does not exist, the settings of that name that ship with the
/// programs, such as configs/paper.yaml; logs which one.
std::filesystem::path settings_file(const std::filesystem::path& file);

/// A program's command line. Create one, add flags, then call run():
///
///   int main(int argc, char** argv) {
///     Program program("jade_inspect", "Says what is in a data set, a run or a .ply");
///     program.add_example("jade_inspect data/desk");
///     program.begin_group("Input");
///     std::string path;
///     program.cli().add_option("path", path, "…")->required();
///     program.add_json_flag();
///     return program.run(argc, argv, [&] { …; return ExitCode::kOk; });
///   }
class Program {
 public:
  /// Adds --version, --log-level and --quiet.
  Program(const std::string& name, const std::string& description);

  CLI::App& cli() { return cli_; }

  /// Starts a group of flags in --help: Input, Output or another.
  void begin_group(const std::string& name) { cli_.option_defaults()->group(name); }
  /// Adds an example command line to --help, of the program or of one of its subcommands.
  void add_example(const std::string& command) { add_example(cli_, command); }
  void add_example(const CLI::App& cli, const std::string& command) {
    help_->add_example(&cli, command);
  }

  /// --config, --set, --print-config, --print-schema, of the program or of one of its subcommands.
  void add_config_flags() { add_config_flags(cli_); }
  void add_config_flags(CLI::App& cli);
  /// Replaces the sentence about the order of settings in --help.
  void set_settings_order(const std::string& order) { settings_order_ = order; }
  /// A flag (or, without dashes, a positional argument) that sets a key and overrides --set. `help`
  /// may leave the range and the default to --print-config.
  CLI::Option* add_key_flag(const std::string& flag, const std::string& key,
                            const std::string& help);
  /// A flag that sets a key with a list: a YAML list, or its only element.
  CLI::Option* add_key_list_flag(const std::string& flag, const std::string& key,
                                 const std::string& help);
  /// A flag without a value that sets a key to `value`.
  CLI::Option* add_key_switch(const std::string& flag, const std::string& key,
                              const std::string& value, const std::string& help);
  /// --mask IMAGE, which sets `key`.
  void add_mask_flag(const std::string& key);
  /// --threshold-positive, --threshold-negative and --efnet: inputs of a restoration.
  void add_restoration_flags();
  /// --serve[=ADDRESS:PORT]; stores its value in `address`, empty for the default.
  CLI::Option* add_serve_flag(std::string& address, const std::string& help);
  /// --output DIR, of the program or of one of its subcommands.
  CLI::Option* add_output_flag(const std::string& help) { return add_output_flag(cli_, help); }
  CLI::Option* add_output_flag(CLI::App& cli, const std::string& help);
  /// --device auto|cpu|cuda|cuda:N.
  void add_device_flag();
  /// --seed N.
  void add_seed_flag();
  /// --json: results on stdout as JSON.
  void add_json_flag();

  /// Parses, runs `body` and returns the process's exit code. Every jade::Error becomes one line on
  /// stderr (with a trace of its origin at --log-level debug) and its exit code.
  int run(int argc, char** argv, const std::function<ExitCode()>& body);

  /// Returns `options` with --config, --set and key flags applied, after `validate(options)`; or
  /// prints them and returns no value, for --print-config or --print-schema. --device and --seed
  /// set the keys of those names if the options have them.
  /// @param named  if not null, receives the keys that the command line and its files set
  template <class Options>
  std::optional<Options> load_options(Options options = {},
                                      std::set<std::string>* named = nullptr) const {
    config::read(sources(fields_of(options)), fields_of(options), named);
    using config::settle;
    settle(options);
    validate(options);
    const FieldList fields = fields_of(options);
    if (print_config_) std::cout << config::to_yaml(fields, title());
    if (print_schema_) std::cout << config::to_json_schema(fields, title());
    if (print_config_ || print_schema_) return std::nullopt;
    return options;
  }

  /// Applies `file` before every --config.
  void use_config(const std::filesystem::path& file) {
    config_files_.insert(config_files_.begin(), file);
  }
  /// Sets the key to `path`, overriding --set, as add_key_flag() does.
  void use_key(const std::string& key, const std::string& value) {
    key_flags_.push_back({value, key, value});
  }

  /// The command of another program of this project, "build/bin/jade_train" if this one was called
  /// by a path, for messages.
  std::string command(const std::string& program) const { return folder_ + program; }

  /// The first --config; layers() returns the others.
  std::filesystem::path config_file() const;
  std::vector<std::filesystem::path> layers() const;
  const std::vector<std::string>& overrides() const { return overrides_; }
  const std::filesystem::path& output() const { return output_; }
  bool json() const { return json_; }
  /// The device of --device (default auto), for programs without a configuration.
  /// @throws ConfigError or DeviceError.
  torch::Device device() const;
  uint64_t seed() const { return seed_.value_or(0); }

 private:
  config::Sources sources(const FieldList& fields) const;
  /// Error text for a command line that CLI11 rejected, with the nearest word that works.
  std::string refusal(const CLI::ParseError& error, const std::vector<std::string>& words) const;
  /// "; did you mean --output?" for an unknown flag; empty if no known flag is similar.
  std::string flag_hint(const std::string& word) const;
  /// "; use --run runs/table" for a path without a flag; empty if no flag suits it.
  std::string path_hint(const std::string& word) const;
  std::string title() const;
  /// Prints usage and examples, for a call without arguments.
  void print_usage() const;
  /// Describes which settings override others, for the flags that the program has.
  std::string settings_order() const;

  std::string name_;
  std::string folder_;  ///< folder in the program's call: "build/bin/", or empty
  CLI::App cli_;
  std::shared_ptr<HelpFormatter> help_ = std::make_shared<HelpFormatter>();
  std::string settings_order_;
  bool has_key_flags_ = false;
  std::vector<std::filesystem::path> config_files_;
  std::vector<std::string> overrides_;
  std::vector<config::KeyFlag> key_flags_;
  std::filesystem::path output_;
  std::string device_;
  std::optional<uint64_t> seed_;
  bool print_config_ = false;
  bool print_schema_ = false;
  bool json_ = false;
  bool quiet_ = false;
  std::string log_level_ = "info";
};

}  // namespace jade::apps
