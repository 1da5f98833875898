// SPDX-License-Identifier: Apache-2.0
#include "common/help.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <sstream>
#include <sys/ioctl.h>
#include <unistd.h>

#include "jade/core/readable.h"

namespace jade::apps {
namespace {

/// Column of the texts beside the flags; on a narrow terminal they stand below them.
size_t text_column(size_t width) { return width < 60 ? 6 : 26; }

/// Number of characters of UTF-8 text; continuation bytes occupy no column.
size_t columns_of(const std::string& text) {
  return static_cast<size_t>(std::count_if(text.begin(), text.end(), [](char c) {
    return (static_cast<unsigned char>(c) & 0xC0) != 0x80;
  }));
}

/// A number with its thousands apart; other texts as they are.
std::string readable_text(const std::string& text) {
  char* end = nullptr;
  const double number = std::strtod(text.c_str(), &end);
  return text.empty() || *end != '\0' || !std::isfinite(number) ? text : readable(number);
}

/// CLI11 appends each validator to the type's name: "FLOAT:FLOAT in [0 - 1]".
std::string placeholder(const CLI::Option& option) {
  const std::string type = option.get_type_name();
  const std::string word = type.substr(0, type.find(':'));
  return word == "INT" || word == "UINT" ? "N" : word == "FLOAT" ? "X" : word;
}

/// "0.5 to 100000" for an option with a checked range, else empty.
std::string range_text(const CLI::Option& option) {
  const std::string type = option.get_type_name();
  const size_t open = type.find(" in [");
  const size_t dash = type.find(" - ", open == type.npos ? type.size() : open);
  const size_t close = type.find(']', dash == type.npos ? type.size() : dash);
  if (close == type.npos) return "";
  return readable_text(type.substr(open + 5, dash - open - 5)) + " to " +
         readable_text(type.substr(dash + 3, close - dash - 3));
}

bool takes_value(const CLI::Option& option) { return option.get_items_expected_max() != 0; }

std::string names_of(const CLI::Option& option) {
  if (option.get_positional()) return upper(option.get_name(true, false));
  std::string text;
  for (const std::string& name : option.get_snames()) text += (text.empty() ? "-" : ", -") + name;
  for (const std::string& name : option.get_lnames()) text += (text.empty() ? "--" : ", --") + name;
  if (!takes_value(option)) return text;
  const std::string value = placeholder(option);
  return option.get_items_expected_min() == 0 ? text + " [" + value + "]" : text + " " + value;
}

std::string description_of(const CLI::Option& option) {
  std::string more = range_text(option);
  if (takes_value(option) && !option.get_default_str().empty())
    more += (more.empty() ? "default: " : ", default: ") + readable_text(option.get_default_str());
  return option.get_description() + (more.empty() ? "" : " (" + more + ")");
}

std::string line_of(const std::string& name, const std::string& text, size_t width) {
  const size_t begin = text_column(width);
  std::string line = "  " + name;
  if (columns_of(line) + 2 > begin) line += "\n";
  size_t column = line.back() == '\n' ? 0 : columns_of(line);
  line += std::string(begin - column, ' ');
  return line + wrapped(text, width, begin, begin) + "\n";
}

int rank_of(const std::string& group) {
  return group == "Input"      ? 0
         : group == "Output"   ? 1
         : group == "Settings" ? 3
         : group == "Common"   ? 4
                               : 2;
}

/// The options of a subcommand and of its parent programs, which it accepts too.
std::vector<const CLI::Option*> options_of(const CLI::App* app) {
  std::vector<const CLI::Option*> all;
  for (; app != nullptr; app = app->get_parent()) {
    for (const CLI::Option* option : app->get_options()) {
      const bool known = std::any_of(all.begin(), all.end(), [&](const CLI::Option* other) {
        return other->get_name(false, true) == option->get_name(false, true);
      });
      if (!known && !option->get_group().empty()) all.push_back(option);
    }
  }
  return all;
}

std::vector<std::string> groups_of(const std::vector<const CLI::Option*>& options) {
  std::vector<std::string> groups;
  for (const CLI::Option* option : options) {
    if (std::find(groups.begin(), groups.end(), option->get_group()) == groups.end())
      groups.push_back(option->get_group());
  }
  std::stable_sort(groups.begin(), groups.end(), [](const std::string& a, const std::string& b) {
    return rank_of(a) < rank_of(b);
  });
  return groups;
}

bool is_command(const CLI::App* app) { return !app->get_name().empty(); }

/// Lines that begin with spaces keep them when wrapped.
std::string wrapped_lines(const std::string& text, size_t width) {
  std::istringstream lines(text);
  std::string all;
  for (std::string line; std::getline(lines, line);) {
    const size_t indent = std::min(line.find_first_not_of(' '), line.size());
    all += line.substr(0, indent) + wrapped(line.substr(indent), width, indent, indent) + "\n";
  }
  return all;
}

}  // namespace

std::string upper(std::string word) {
  std::transform(word.begin(), word.end(), word.begin(),
                 [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  return word;
}

std::string wrapped(const std::string& text, size_t width, size_t indent, size_t column) {
  std::istringstream words(text);
  std::string out;
  bool starts_line = true;
  for (std::string word; words >> word;) {
    const size_t size = columns_of(word);
    if (!starts_line && column + 1 + size > width) {
      out += "\n" + std::string(indent, ' ');
      column = indent;
      starts_line = true;
    }
    if (!starts_line) out += " ";
    column += size + (starts_line ? 0 : 1);
    out += word;
    starts_line = false;
  }
  return out;
}

size_t help_width() {
  winsize size{};
  const bool known = isatty(STDOUT_FILENO) != 0 && ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) == 0;
  return known && size.ws_col > 0 ? std::clamp<size_t>(size.ws_col, 40, 120) : 80;
}

std::string HelpFormatter::usage(const CLI::App* app, const std::string& name) const {
  const size_t width = help_width();
  const auto commands = app->get_subcommands(is_command);
  std::string line = name;
  if (!commands.empty()) line += " COMMAND";
  for (const CLI::Option* option : app->get_options()) {
    if (!option->get_positional()) continue;
    line += option->get_required() ? " " + names_of(*option) : " [" + names_of(*option) + "]";
  }
  std::string text =
      wrapped(app->get_description(), width, 0, 0) + "\n\nUsage: " + line + " [OPTIONS]\n";
  const auto examples = examples_.find(app);
  if (examples == examples_.end()) return text;
  text += "\nExamples:\n";
  for (const std::string& example : examples->second) text += "  " + example + "\n";
  return text;
}

std::string HelpFormatter::make_help(const CLI::App* app, std::string name,
                                     CLI::AppFormatMode) const {
  const size_t width = help_width();
  std::string text = usage(app, name);
  const auto commands = app->get_subcommands(is_command);
  if (!commands.empty()) text += "\nCommands:\n";
  for (const CLI::App* command : commands) {
    text += line_of(command->get_name(), command->get_description(), width);
  }
  std::vector<const CLI::Option*> options = options_of(app);
  std::stable_partition(options.begin(), options.end(),
                        [](const CLI::Option* option) { return option->get_name() == "--output"; });
  for (const std::string& group : groups_of(options)) {
    text += "\n" + group + ":\n";
    for (const CLI::Option* option : options) {
      if (option->get_group() == group)
        text += line_of(names_of(*option), description_of(*option), width);
    }
  }
  const std::string footer = wrapped_lines(app->get_footer(), width);
  return footer.empty() ? text : text + "\n" + footer;
}

}  // namespace jade::apps
