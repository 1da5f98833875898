// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "jade/config/config.h"
#include "jade/config/text.h"
#include "jade/core/error.h"

namespace jade::config {
namespace {

size_t depth_of(const std::string& key) {
  return static_cast<size_t>(std::count(key.begin(), key.end(), '.'));
}

std::string last_part(const std::string& key) { return key.substr(key.rfind('.') + 1); }

std::string parent_of(const std::string& key) {
  const size_t dot = key.rfind('.');
  return dot == std::string::npos ? "" : key.substr(0, dot);
}

/// Number of steps that a share amounts to in this run.
std::string share_text(const Steps& steps) {
  std::string text = ", or a share such as 6%";
  if (steps.at_least() > 0) text += concat(", at least ", steps.at_least());
  if (steps.is_share()) text += concat("; here ", int64_t{steps}, " steps");
  return text;
}

/// "help (a|b)" or "help (0 to 1)".
std::string comment(const Field& field) {
  std::string limits = range_text(field);
  if (const auto* choice = std::get_if<EnumPointer>(&field.value)) {
    limits = joined_words(choice->entries(), "|");
  }
  if (const auto* steps = std::get_if<Steps*>(&field.value)) limits += share_text(**steps);
  return limits.empty() ? field.help : field.help + " (" + limits + ")";
}

/// Meanings of an enum's words, "word: help" each; empty for other fields.
std::vector<std::string> meanings(const Field& field) {
  std::vector<std::string> lines;
  if (const auto* choice = std::get_if<EnumPointer>(&field.value)) {
    for (const EnumPointer::Entry& entry : choice->entries()) {
      if (!entry.help.empty()) lines.push_back(entry.word + ": " + entry.help);
    }
  }
  return lines;
}

struct SchemaType {
  nlohmann::ordered_json operator()(const bool*) const { return {{"type", "boolean"}}; }
  nlohmann::ordered_json operator()(const int*) const { return {{"type", "integer"}}; }
  nlohmann::ordered_json operator()(const int64_t*) const { return {{"type", "integer"}}; }
  nlohmann::ordered_json operator()(const Steps*) const {
    return {{"type", {"integer", "string"}}, {"pattern", "^[0-9.]+ *%$"}};
  }
  nlohmann::ordered_json operator()(const double*) const { return {{"type", "number"}}; }
  nlohmann::ordered_json operator()(const AutoNumber*) const {
    return {{"type", {"number", "string"}}, {"pattern", "^auto$"}};
  }
  nlohmann::ordered_json operator()(const AutoCount*) const {
    return {{"type", {"integer", "string"}}, {"pattern", "^auto$"}};
  }
  nlohmann::ordered_json operator()(const std::string*) const { return {{"type", "string"}}; }
  nlohmann::ordered_json operator()(const std::filesystem::path*) const {
    return {{"type", "string"}};
  }
  nlohmann::ordered_json operator()(const std::vector<int64_t>*) const { return list("integer"); }
  nlohmann::ordered_json operator()(const std::vector<double>*) const { return list("number"); }
  nlohmann::ordered_json operator()(const std::vector<std::string>*) const {
    return list("string");
  }
  nlohmann::ordered_json operator()(const EnumPointer&) const { return {{"type", "string"}}; }
  static nlohmann::ordered_json list(const char* of) {
    return {{"type", "array"}, {"items", {{"type", of}}}};
  }
};

nlohmann::ordered_json field_schema(const Field& field) {
  nlohmann::ordered_json schema = std::visit(SchemaType{}, field.value);
  std::string description = field.help;
  for (const std::string& line : meanings(field)) description += "\n" + line;
  schema["description"] = description;
  schema["default"] = nlohmann::ordered_json::parse(value_text(field.value), nullptr, false);
  if (schema["default"].is_discarded()) schema["default"] = value_text(field.value);
  auto& limited = schema["type"] == "array" ? schema["items"] : schema;
  if (field.range && std::isfinite(field.range->min)) limited["minimum"] = field.range->min;
  if (field.range && std::isfinite(field.range->max)) limited["maximum"] = field.range->max;
  if (const auto* choice = std::get_if<EnumPointer>(&field.value)) {
    for (const EnumPointer::Entry& entry : choice->entries()) schema["enum"].push_back(entry.word);
  }
  return schema;
}

nlohmann::ordered_json group_schema(const std::string& help) {
  nlohmann::ordered_json schema{{"type", "object"}};
  if (!help.empty()) schema["description"] = help;
  schema["additionalProperties"] = false;
  schema["properties"] = nlohmann::ordered_json::object();
  return schema;
}

}  // namespace

std::string to_yaml(const FieldList& fields, const std::string& title) {
  std::string out = "# " + title + "\n";
  std::string open_group;
  for (const Field& field : fields.fields()) {
    const std::string parent = parent_of(field.key);
    if (parent != open_group) {
      // Open every group on the way that is not open yet.
      for (const FieldGroup& group : fields.groups()) {
        const bool on_the_way = parent == group.key || parent.rfind(group.key + ".", 0) == 0;
        const bool already = open_group == group.key || open_group.rfind(group.key + ".", 0) == 0;
        if (!on_the_way || already) continue;
        const std::string indent(2 * depth_of(group.key), ' ');
        if (indent.empty()) out += "\n";
        out += indent + last_part(group.key) + ":" +
               (group.help.empty() ? "" : "  # " + group.help) + "\n";
      }
      open_group = parent;
    }
    const std::string indent(2 * depth_of(field.key), ' ');
    out += indent + last_part(field.key) + ": " + value_text(field.value) + "  # " +
           comment(field) + "\n";
    for (const std::string& line : meanings(field)) out += concat(indent, "  # ", line, "\n");
  }
  return out;
}

std::string to_json_schema(const FieldList& fields, const std::string& title) {
  nlohmann::ordered_json root = group_schema("");
  const auto node_of = [&](const std::string& key) -> nlohmann::ordered_json& {
    nlohmann::ordered_json* node = &root;
    for (size_t start = 0; start < key.size();) {
      const size_t dot = std::min(key.find('.', start), key.size());
      node = &(*node)["properties"][key.substr(start, dot - start)];
      start = dot + 1;
    }
    return *node;
  };
  root["properties"]["extends"] = {
      {"description", "YAML files to start from, relative to this one; later keys win"},
      {"type", {"string", "array"}},
      {"items", {{"type", "string"}}}};
  for (const FieldGroup& group : fields.groups()) node_of(group.key) = group_schema(group.help);
  for (const Field& field : fields.fields()) node_of(field.key) = field_schema(field);
  nlohmann::ordered_json out{{"$schema", "https://json-schema.org/draft/2020-12/schema"},
                             {"title", title}};
  out.update(root);
  return out.dump(2) + "\n";
}

std::vector<std::pair<std::string, std::string>> values(const FieldList& fields) {
  std::vector<std::pair<std::string, std::string>> out;
  for (const Field& field : fields.fields()) out.emplace_back(field.key, value_text(field.value));
  return out;
}

}  // namespace jade::config
