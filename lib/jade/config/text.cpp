// SPDX-License-Identifier: Apache-2.0
#include "jade/config/text.h"

#include <charconv>
#include <cmath>

#include "jade/core/readable.h"

namespace jade::config {
namespace {

/// A double-quoted YAML scalar where a plain one would read as something else.
std::string quoted(const std::string& text) {
  const bool plain =
      !text.empty() &&
      text.find_first_not_of(
          "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"
          "0123456789_./-+") == std::string::npos &&
      text.find_first_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ/_") == 0 &&
      text != "true" && text != "false" && text != "null" && text != "yes" && text != "no" &&
      text != "on" && text != "off" && text != "y" && text != "n";
  if (plain) return text;
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    if (c == '\n') {
      out += "\\n";
    } else if (c == '\t') {
      out += "\\t";
    } else {
      out += c;
    }
  }
  return out + "\"";
}

template <class T>
std::string list_text(const std::vector<T>& list) {
  std::string out = "[";
  for (size_t i = 0; i < list.size(); ++i) {
    T item = list[i];
    out += (i ? ", " : "") + value_text(FieldPointer{&item});
  }
  return out + "]";
}

struct ValueText {
  std::string operator()(const bool* v) const { return *v ? "true" : "false"; }
  std::string operator()(const int* v) const { return std::to_string(*v); }
  std::string operator()(const int64_t* v) const { return std::to_string(*v); }
  std::string operator()(const Steps* v) const {
    return v->is_share() ? number_text(v->percent()) + "%" : std::to_string(int64_t{*v});
  }
  std::string operator()(const double* v) const { return number_text(*v); }
  std::string operator()(const AutoNumber* v) const {
    return v->is_auto() ? "auto" : number_text(*v);
  }
  std::string operator()(const AutoCount* v) const {
    return v->is_auto() ? "auto" : std::to_string(int64_t{*v});
  }
  std::string operator()(const std::string* v) const { return quoted(*v); }
  std::string operator()(const std::filesystem::path* v) const { return quoted(v->string()); }
  std::string operator()(const std::vector<int64_t>* v) const { return list_text(*v); }
  std::string operator()(const std::vector<double>* v) const { return list_text(*v); }
  std::string operator()(const std::vector<std::string>* v) const { return list_text(*v); }
  std::string operator()(const EnumPointer& v) const { return quoted(v.word()); }
};

struct TypeText {
  std::string operator()(const bool*) const { return "true or false"; }
  std::string operator()(const int*) const { return "a whole number"; }
  std::string operator()(const int64_t*) const { return "a whole number"; }
  std::string operator()(const Steps*) const {
    return "a whole number of steps or a share of the run such as 6%";
  }
  std::string operator()(const double*) const { return "a number"; }
  std::string operator()(const AutoNumber*) const { return "auto or a number"; }
  std::string operator()(const AutoCount*) const { return "auto or a whole number"; }
  std::string operator()(const std::string*) const { return "a text"; }
  std::string operator()(const std::filesystem::path*) const { return "a path"; }
  std::string operator()(const std::vector<int64_t>*) const { return "a list of whole numbers"; }
  std::string operator()(const std::vector<double>*) const { return "a list of numbers"; }
  std::string operator()(const std::vector<std::string>*) const { return "a list of texts"; }
  std::string operator()(const EnumPointer& v) const {
    return "one of " + joined_words(v.entries(), ", ");
  }
};

}  // namespace

std::string joined_words(const std::vector<EnumPointer::Entry>& entries,
                         const std::string& separator) {
  std::string out;
  for (const EnumPointer::Entry& entry : entries)
    out += (out.empty() ? "" : separator) + entry.word;
  return out;
}

std::string number_text(double value) {
  if (std::isnan(value)) return ".nan";
  if (std::isinf(value)) return value > 0 ? ".inf" : "-.inf";
  char buffer[32];
  const auto result = std::to_chars(buffer, buffer + sizeof buffer, value);
  return std::string(buffer, result.ptr);
}

bool read_percent(const std::string& text, double& percent) {
  const char* const end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data(), end, percent);
  if (error != std::errc() || !(percent >= 0) || std::isinf(percent)) return false;
  const std::string unit(rest, end);
  return unit == "%" || unit == " %";
}

std::string value_text(const FieldPointer& value) { return std::visit(ValueText{}, value); }

std::string type_text(const FieldPointer& value) { return std::visit(TypeText{}, value); }

std::string range_text(const Field& field) {
  if (!field.range) return "";
  const bool below = std::isfinite(field.range->min), above = std::isfinite(field.range->max);
  constexpr int kDigits = 9;
  const std::string least = readable(field.range->min, kDigits);
  const std::string most = readable(field.range->max, kDigits);
  if (below && above) return least + " to " + most;
  if (below) return least + " or more";
  return above ? "at most " + most : "";
}

std::string expectation(const Field& field) {
  const std::string range = range_text(field);
  if (range.empty()) return type_text(field.value);
  const bool has_two_ends = range.find(" to ") != std::string::npos;
  return type_text(field.value) + (has_two_ends ? " from " : ", ") + range;
}

}  // namespace jade::config
