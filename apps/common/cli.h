// SPDX-License-Identifier: Apache-2.0
// What all programs share: flags, --version, logging, signals, and errors turned into exit codes.
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

/// A flag's whole number, decimal also with leading zeros, which CLI11 takes for octal.
/// @param least  0 or 1
CLI::Validator whole_number(int64_t least);

/// `file`, or, where that relative path leads nowhere, the settings of that name that ship with the
/// programs, such as configs/paper.yaml; which is logged.
std::filesystem::path settings_file(const std::filesystem::path& file);

/// A program's command line. Make one, add flags, then call run():
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

  /// The group in --help of the flags that are added next: Input, Output or another.
  void begin_group(const std::string& name) { cli_.option_defaults()->group(name); }
  /// A command line for --help, of the program or of one of its subcommands.
  void add_example(const std::string& command) { add_example(cli_, command); }
  void add_example(const CLI::App& cli, const std::string& command) {
    help_->add_example(&cli, command);
  }

  /// --config, --set, --print-config, --print-schema, of the program or of one of its subcommands.
  void add_config_flags() { add_config_flags(cli_); }
  void add_config_flags(CLI::App& cli);
  /// Replaces the sentence about the order of settings in --help.
  void set_settings_order(const std::string& order) { settings_order_ = order; }
  /// A flag (or, without dashes, a positional argument) that stands for a key and wins over --set.
  /// `help` may leave the range and the default to --print-config.
  CLI::Option* add_key_flag(const std::string& flag, const std::string& key,
                            const std::string& help);
  /// A flag that stands for a key with a list: a YAML list, or its only element.
  CLI::Option* add_key_list_flag(const std::string& flag, const std::string& key,
                                 const std::string& help);
  /// A flag without a value that sets a key to `value`.
  CLI::Option* add_key_switch(const std::string& flag, const std::string& key,
                              const std::string& value, const std::string& help);
  /// --mask IMAGE, which stands for `key`.
  void add_mask_flag(const std::string& key);
  /// --threshold-positive, --threshold-negative and --efnet: inputs of a restoration.
  void add_restoration_flags();
  /// --serve[=ADDRESS:PORT], which fills `address` with what is given, empty for the default.
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

  /// `options` with --config, --set and the flags that stand for keys laid over them, after
  /// `validate(options)`, or nothing when --print-config or --print-schema asked for a print, which
  /// is then done. --device and --seed stand for the keys of those names where the options have
  /// them.
  /// @param named  if not null, the keys that the command line and its files name are added to it
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

  /// Lays `file` below every --config.
  void use_config(const std::filesystem::path& file) {
    config_files_.insert(config_files_.begin(), file);
  }
  /// `path` as a value of the key, which wins over --set; as add_key_flag() does.
  void use_key(const std::string& key, const std::string& value) {
    key_flags_.push_back({value, key, value});
  }

  /// The command of another of our programs, "build/bin/jade_train" where this one was called by a
  /// path, for messages.
  std::string command(const std::string& program) const { return folder_ + program; }

  /// The first --config; those after it are layers().
  std::filesystem::path config_file() const;
  std::vector<std::filesystem::path> layers() const;
  const std::vector<std::string>& overrides() const { return overrides_; }
  const std::filesystem::path& output() const { return output_; }
  bool json() const { return json_; }
  /// The device of --device (default auto), for programs without a configuration.
  /// @throws ConfigError or DeviceError.
  torch::Device device() const;
  const std::string& device_choice() const { return device_; }
  uint64_t seed() const { return seed_.value_or(0); }

 private:
  config::Sources sources(const FieldList& fields) const;
  /// Hint for the words of a command line that CLI11 refused: "; did you mean --output?"; empty if
  /// no known word is near.
  std::string hint(const std::vector<std::string>& words) const;
  std::string title() const;
  /// Prints usage and examples, for a call without arguments.
  void print_usage() const;
  /// Which settings win, by the flags that the program has.
  std::string settings_order() const;

  std::string name_;
  std::string folder_;  ///< as it was called: "build/bin/", or empty
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
