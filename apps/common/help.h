// SPDX-License-Identifier: Apache-2.0
// The text of --help: usage, examples, and flags in groups, wrapped at words.
#pragma once

#include <CLI/CLI.hpp>
#include <map>
#include <string>
#include <vector>

namespace jade::apps {

/// Wraps `text` to lines of at most `width` characters at spaces. Every line but the first begins
/// with `indent` spaces; the first begins at column `column`. A word longer than a line is not
/// split.
std::string wrapped(const std::string& text, size_t width, size_t indent, size_t column);

/// The word in capitals.
std::string upper(std::string word);

/// Width in columns of the terminal on standard output, from 40 to 120; 80 if it is not a terminal.
size_t help_width();

/// Groups are in the order Input, Output, others as declared, Settings, Common.
class HelpFormatter : public CLI::Formatter {
 public:
  /// A whole command line of `app` for its help.
  void add_example(const CLI::App* app, const std::string& command) {
    examples_[app].push_back(command);
  }

  std::string make_help(const CLI::App* app, std::string name,
                        CLI::AppFormatMode mode) const override;

  /// The first lines of the help: what the program does, its usage and examples.
  std::string usage(const CLI::App* app, const std::string& name) const;

 private:
  std::map<const CLI::App*, std::vector<std::string>> examples_;
};

}  // namespace jade::apps
