// SPDX-License-Identifier: Apache-2.0
#include "common/interface.h"

#include <nlohmann/json.hpp>
#include <vector>

namespace jade::apps {
namespace {

/// Parses CLI11's "TEXT:{a,b}": returns the words between the braces.
std::vector<std::string> choices_of(const std::string& type) {
  const size_t begin = type.find('{'), end = type.rfind('}');
  std::vector<std::string> words;
  if (begin == std::string::npos || end == std::string::npos || end < begin) return words;
  std::string word;
  for (const char letter : type.substr(begin + 1, end - begin - 1) + ",") {
    if (letter != ',') {
      word += letter;
      continue;
    }
    words.push_back(word);
    word.clear();
  }
  return words;
}

nlohmann::json option_of(const CLI::Option& option) {
  std::vector<std::string> flags;
  for (const std::string& name : option.get_snames()) flags.push_back("-" + name);
  for (const std::string& name : option.get_lnames()) flags.push_back("--" + name);
  const std::string type = option.get_type_name();
  const bool takes_value = option.get_items_expected_max() > 0;
  return {{"flags", flags},
          {"positional", option.get_positional() ? option.get_name(true) : ""},
          {"value", takes_value ? type.substr(0, type.find(':')) : ""},
          {"optional_value", takes_value && option.get_items_expected_min() == 0},
          {"choices", choices_of(type)},
          {"help", option.get_description()},
          {"group", option.get_group()}};
}

nlohmann::json described(const CLI::App& app) {
  nlohmann::json options = nlohmann::json::array(), commands = nlohmann::json::array();
  for (const CLI::Option* const option : app.get_options()) {
    if (!option->get_group().empty()) options.push_back(option_of(*option));
  }
  for (const CLI::App* const command : app.get_subcommands([](const CLI::App*) { return true; })) {
    commands.push_back(described(*command));
  }
  return {{"name", app.get_name()},
          {"description", app.get_description()},
          {"footer", app.get_footer()},
          {"options", options},
          {"commands", commands}};
}

}  // namespace

std::string interface_json(const CLI::App& app) { return described(app).dump(2); }

}  // namespace jade::apps
