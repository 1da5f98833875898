// SPDX-License-Identifier: Apache-2.0
// The only reader of YAML.
#include <algorithm>
#include <cctype>
#include <cmath>
#include <fstream>
#include <iostream>
#include <iterator>
#include <set>
#include <yaml-cpp/yaml.h>

#include "jade/config/config.h"
#include "jade/config/problems.h"
#include "jade/config/text.h"
#include "jade/core/error.h"
#include "jade/core/log.h"

namespace jade::config {
namespace {

namespace fs = std::filesystem;

/// One source of settings: a parsed tree, its name in messages, and the folder of its relative
/// paths.
struct Layer {
  YAML::Node root;
  std::string name;
  fs::path folder;
  bool has_lines;  ///< false for --set and flags, whose positions are meaningless to a user
};

/// Programs read their file more than once; each warning is shown once.
void warn_once(const std::string& message) {
  static std::set<std::string> said;
  if (said.insert(message).second) log_warn(message);
}

class Reader {
 public:
  explicit Reader(const FieldList& fields, std::set<std::string>* named = nullptr)
      : fields_(fields), named_(named) {}

  void apply(const Layer& layer) {
    if (layer.root.IsNull()) return;
    if (!layer.root.IsMap()) {
      complain(layer, layer.root, "expected 'key: value' lines, found " + kind_of(layer.root));
      return;
    }
    apply_map(layer, layer.root, "");
  }

  void complain(const Layer& layer, const YAML::Node& node, const std::string& what) {
    problems_.add(place(layer, node) + ": " + what);
  }

  void throw_problems() {
    for (const FixedKey& given : fixed_) check_fixed(given);
    problems_.throw_if_any();
  }

 private:
  /// A key that has become a constant, as a source sets it.
  struct FixedKey {
    std::string place, key, found;
  };

  /// Runs after all sources are read, because the constant may depend on a field.
  void check_fixed(const FixedKey& given) {
    const std::string value = (*fields_.fixed_value(given.key))();
    if (is_same_value(given.found, value)) return;
    problems_.add(given.place + ": " + given.key + ": expected " + value +
                  ", which is its only value now (\"Removed keys\" in CHANGELOG.md), found '" +
                  given.found + "'; remove the key");
  }

  static bool is_same_value(const std::string& a, const std::string& b) {
    double first = 0, second = 0;
    const bool shares = read_percent(a, first);
    if (shares != read_percent(b, second)) return false;
    const bool numbers = shares || (YAML::convert<double>::decode(YAML::Node(a), first) &&
                                    YAML::convert<double>::decode(YAML::Node(b), second));
    return numbers ? std::abs(first - second) <= 1e-5 * std::abs(second) : a == b;
  }

  static std::string place(const Layer& layer, const YAML::Node& node) {
    if (!layer.has_lines || node.Mark().line < 0) return layer.name;
    return concat(layer.name, ":", node.Mark().line + 1, ":", node.Mark().column + 1);
  }

  static std::string kind_of(const YAML::Node& node) {
    if (node.IsNull()) return "nothing";
    if (node.IsMap()) return "a group of keys";
    if (node.IsSequence()) return "a list";
    return "'" + node.Scalar() + "'";
  }

  void apply_map(const Layer& layer, const YAML::Node& map, const std::string& prefix) {
    std::set<std::string> seen;
    for (const auto& entry : map) {
      const std::string name = entry.first.IsScalar() ? entry.first.Scalar() : std::string("?");
      std::string key = prefix + name;
      if (prefix.empty() && name == "extends") continue;
      if (const std::string* renamed = fields_.new_key(key)) {
        warn_once(concat(place(layer, entry.first), ": ", key, " is now called ", *renamed,
                         "; the old name still works"));
        key = *renamed;
      }
      if (!seen.insert(name).second) {
        complain(layer, entry.first, key + ": given twice");
      } else if (fields_.is_group(key)) {
        if (entry.second.IsMap()) {
          apply_map(layer, entry.second, key + ".");
        } else if (!entry.second.IsNull()) {
          complain(layer, entry.second,
                   key + ": expected a group of keys, found " + kind_of(entry.second));
        }
      } else if (const Field* field = fields_.find(key)) {
        apply_field(layer, entry.second, *field);
      } else if (fields_.fixed_value(key) != nullptr) {
        const bool scalar = entry.second.IsScalar();
        fixed_.push_back({place(layer, entry.second), key,
                          scalar ? entry.second.Scalar() : kind_of(entry.second)});
      } else {
        complain(layer, entry.first, key + ": unknown key" + hint(key));
      }
    }
  }

  std::string hint(const std::string& key) const {
    std::vector<std::string> known;
    for (const Field& field : fields_.fields()) known.push_back(field.key);
    for (const FieldGroup& group : fields_.groups()) known.push_back(group.key);
    const std::string close = nearest(key, known);
    return close.empty() ? "; --print-config lists all keys" : "; did you mean " + close + "?";
  }

  void apply_field(const Layer& layer, const YAML::Node& node, const Field& field) {
    if (named_) named_->insert(field.key);
    const bool read = std::visit(
        [&](const auto& target) { return convert(layer, node, pointed(target)); }, field.value);
    if (!read || !within(field)) {
      complain(layer, node,
               field.key + ": expected " + expectation(field) + ", found " + kind_of(node) +
                   word_hint(node, field));
    }
  }

  static std::string word_hint(const YAML::Node& node, const Field& field) {
    const auto* choice = std::get_if<EnumPointer>(&field.value);
    if (!choice || !node.IsScalar()) return "";
    std::vector<std::string> words;
    for (const EnumPointer::Entry& entry : choice->entries()) words.push_back(entry.word);
    const std::string close = nearest(node.Scalar(), words);
    return close.empty() ? "" : "; did you mean " + close + "?";
  }

  static bool within(const Field& field) {
    if (!field.range) return true;
    const auto in = [&](double x) { return x >= field.range->min && x <= field.range->max; };
    if (const auto* v = std::get_if<int*>(&field.value)) return in(**v);
    if (const auto* v = std::get_if<int64_t*>(&field.value)) return in(static_cast<double>(**v));
    if (const auto* v = std::get_if<Steps*>(&field.value))
      return in(static_cast<double>(int64_t{**v}));
    if (const auto* v = std::get_if<double*>(&field.value)) return in(**v);
    if (const auto* v = std::get_if<AutoNumber*>(&field.value)) return (*v)->is_auto() || in(**v);
    if (const auto* v = std::get_if<AutoCount*>(&field.value)) {
      return in(static_cast<double>(int64_t{**v}));
    }
    if (const auto* v = std::get_if<std::vector<double>*>(&field.value)) {
      return std::all_of((*v)->begin(), (*v)->end(), in);
    }
    if (const auto* v = std::get_if<std::vector<int64_t>*>(&field.value)) {
      return std::all_of((*v)->begin(), (*v)->end(),
                         [&](int64_t x) { return in(static_cast<double>(x)); });
    }
    return true;
  }

  template <class T>
  static T& pointed(T* target) {
    return *target;
  }
  static const EnumPointer& pointed(const EnumPointer& target) { return target; }

  static bool convert(const Layer& layer, const YAML::Node& node, const EnumPointer& target) {
    if (!node.IsScalar()) return false;
    const std::string& word = node.Scalar();
    for (size_t i = 0; i < target.entries().size(); ++i) {
      const EnumPointer::Entry& entry = target.entries()[i];
      const bool is_old = !entry.old_word.empty() && word == entry.old_word;
      if (word != entry.word && !is_old) continue;
      if (is_old) {
        warn_once(concat(place(layer, node), ": ", word, " is now called ", entry.word,
                         "; the old name still works"));
      }
      target.set(i);
      return true;
    }
    return false;
  }
  template <class T>
  static bool convert_scalar(const YAML::Node& node, T& target) {
    // A quoted scalar carries the tag "!": "3" in quotes is a text, not a number.
    return node.IsScalar() && node.Tag() != "!" && YAML::convert<T>::decode(node, target);
  }
  /// Whether a decimal number has a leading zero, such as 010 or -08.
  static bool starts_with_zero(const YAML::Node& node) {
    if (!node.IsScalar()) return false;
    const std::string& text = node.Scalar();
    const size_t first = text.find_first_not_of("+-");
    return first != std::string::npos && text[first] == '0' &&
           text.find_first_not_of("0123456789", first) == std::string::npos;
  }
  static bool convert(const Layer&, const YAML::Node& node, bool& target) {
    return convert_scalar(node, target);
  }
  static bool convert(const Layer&, const YAML::Node& node, double& target) {
    return convert_scalar(node, target) && !std::isnan(target);
  }
  template <class T>
  static bool convert(const Layer& layer, const YAML::Node& node, Auto<T>& target) {
    if (node.IsScalar() && node.Scalar() == "auto") {
      target.set_auto();
      return true;
    }
    T value = 0;
    if (!convert(layer, node, value)) return false;
    target = value;
    return true;
  }
  static bool convert(const Layer&, const YAML::Node& node, int64_t& target) {
    double value = 0;
    // yaml-cpp would read 010 as octal.
    if (!starts_with_zero(node) && convert_scalar(node, target)) return true;
    // 1e4 is a whole number too.
    if (!convert_scalar(node, value) || value != std::floor(value) || std::abs(value) > 9e15)
      return false;
    target = static_cast<int64_t>(value);
    return true;
  }
  static bool convert(const Layer& layer, const YAML::Node& node, Steps& target) {
    int64_t count = 0;
    if (convert(layer, node, count)) {
      target.set_count(count);
      return true;
    }
    double percent = 0;
    if (!node.IsScalar() || !read_percent(node.Scalar(), percent)) return false;
    percent > 0 ? target.set_percent(percent) : target.set_count(0);
    return true;
  }
  static bool convert(const Layer& layer, const YAML::Node& node, int& target) {
    int64_t wide = 0;
    if (!convert(layer, node, wide) || wide != static_cast<int>(wide)) return false;
    target = static_cast<int>(wide);
    return true;
  }
  static bool convert(const Layer&, const YAML::Node& node, std::string& target) {
    if (!node.IsScalar()) return false;
    target = node.Scalar();
    return true;
  }
  static bool convert(const Layer& layer, const YAML::Node& node, fs::path& target) {
    std::string text;
    if (!convert(layer, node, text)) return false;
    target = text.empty() ? fs::path() : fs::path(text);
    if (!text.empty() && target.is_relative())
      target = fs::absolute(layer.folder / target).lexically_normal();
    const size_t dollar = text.find('$');
    const bool variable = dollar != std::string::npos && dollar + 1 < text.size() &&
                          (std::isalpha(static_cast<unsigned char>(text[dollar + 1])) != 0 ||
                           text[dollar + 1] == '{' || text[dollar + 1] == '_');
    std::error_code error;
    if ((variable || text.rfind('~', 0) == 0) && !fs::exists(target, error)) {
      warn_once(concat(layer.name, ": expected a whole path, found '", text,
                       "': ~ and $VARIABLES are not expanded here; write the path out"));
    }
    return true;
  }
  template <class T>
  static bool convert(const Layer& layer, const YAML::Node& node, std::vector<T>& target) {
    if (!node.IsSequence()) return false;
    std::vector<T> list;
    for (const auto& entry : node) {
      T item{};
      if (!convert(layer, entry, item)) return false;
      list.push_back(item);
    }
    target = std::move(list);
    return true;
  }

  const FieldList& fields_;
  std::set<std::string>* named_;
  std::vector<FixedKey> fixed_;
  Problems problems_;
};

YAML::Node parse(const std::string& text, const std::string& name) {
  try {
    const std::vector<YAML::Node> documents = YAML::LoadAll(text);
    if (documents.size() > 1) {
      throw ConfigError(concat(name, ": expected one YAML document, found ", documents.size(),
                               " with --- between them; give each its own --config"));
    }
    return documents.empty() ? YAML::Node() : documents.front();
  } catch (const YAML::Exception& failure) {
    throw ConfigError(concat(name, ":", failure.mark.line + 1, ":", failure.mark.column + 1,
                             ": not valid YAML: ", failure.msg));
  }
}

std::string contents(const fs::path& file) {
  if (file == "-" || file == "/dev/stdin") return {std::istreambuf_iterator<char>(std::cin), {}};
  std::ifstream in(file, std::ios::binary);
  if (!in || fs::is_directory(file)) {
    throw ConfigError(concat(file.string(), ": expected a YAML file, found ",
                             fs::is_directory(file) ? "a folder" : "no file that can be read"));
  }
  return {std::istreambuf_iterator<char>(in), {}};
}

/// Appends the file's layer after those that it extends.
void collect_layers(const fs::path& file, std::vector<fs::path>& chain,
                    std::vector<Layer>& layers) {
  const bool from_stdin = file == "-" || file == "/dev/stdin";
  const fs::path identity = from_stdin ? file : fs::weakly_canonical(file);
  if (std::find(chain.begin(), chain.end(), identity) != chain.end()) {
    std::string circle;
    for (const fs::path& link : chain) circle += link.filename().string() + " -> ";
    throw ConfigError(concat(file.string(), ": 'extends' goes in a circle: ", circle,
                             identity.filename().string()));
  }
  chain.push_back(identity);
  Layer layer{parse(contents(file), file.string()), file.string(),
              from_stdin ? fs::current_path() : fs::absolute(file).parent_path(), true};
  if (layer.root.IsMap() && layer.root["extends"]) {
    const YAML::Node parents = layer.root["extends"];
    if (!parents.IsScalar() && !parents.IsSequence()) {
      throw ConfigError(concat(layer.name, ": extends: expected a path or a list of paths"));
    }
    const auto extend = [&](const YAML::Node& parent) {
      const fs::path path = layer.folder / parent.Scalar();
      if (!fs::exists(path)) {
        throw ConfigError(concat(layer.name, ":", parent.Mark().line + 1, ":",
                                 parent.Mark().column + 1,
                                 ": extends: no such file: ", path.lexically_normal().string()));
      }
      collect_layers(path.lexically_normal(), chain, layers);
    };
    if (parents.IsScalar()) {
      extend(parents);
    } else {
      for (const auto& parent : parents) extend(parent);
    }
  }
  chain.pop_back();
  layers.push_back(std::move(layer));
}

/// The tree of one key.
YAML::Node tree_of(const std::string& key, YAML::Node value) {
  std::vector<std::string> path;
  for (size_t start = 0; start <= key.size();) {
    const size_t dot = std::min(key.find('.', start), key.size());
    path.push_back(key.substr(start, dot - start));
    start = dot + 1;
  }
  for (auto part = path.rbegin(); part != path.rend(); ++part) {
    YAML::Node outer(YAML::NodeType::Map);
    outer[*part] = value;
    value = outer;
  }
  return value;
}

/// Whether YAML would cut the text at a comment or read it as a key; paths may contain both.
bool is_verbatim(const std::string& text) {
  if (text.empty() || std::string("[{\"'").find(text[0]) != std::string::npos) return false;
  return text[0] == '#' || text.find(" #") != std::string::npos ||
         text.find(": ") != std::string::npos;
}

Layer override_layer(const std::string& assignment) {
  const size_t equals = assignment.find('=');
  const std::string name = "--set " + assignment;
  if (equals == std::string::npos || equals == 0) {
    throw ConfigError(name + ": expected key=value, such as train.iterations=1000");
  }
  if (assignment.substr(0, equals) == "extends") {
    throw ConfigError(name + ": only a file can extend others; name them with --config");
  }
  const std::string text = assignment.substr(equals + 1);
  YAML::Node value = is_verbatim(text) ? YAML::Node(text) : parse(text, name);
  // An empty right side means the empty text.
  if (value.IsNull() && equals + 1 == assignment.size()) value = YAML::Node(std::string());
  return {tree_of(assignment.substr(0, equals), value), name, fs::current_path(), false};
}

YAML::Node value_of(const KeyFlag& flag) {
  if (!flag.is_list) return YAML::Node(flag.value);
  const YAML::Node value = parse(flag.value, flag.text);
  if (value.IsSequence()) return value;
  YAML::Node list(YAML::NodeType::Sequence);
  list.push_back(value);
  return list;
}

Layer flag_layer(const KeyFlag& flag) {
  return {tree_of(flag.key, value_of(flag)), flag.text, fs::current_path(), false};
}

}  // namespace

void read(const Sources& sources, const FieldList& fields, std::set<std::string>* named) {
  std::vector<Layer> layers;
  std::vector<fs::path> chain;
  if (!sources.file.empty()) collect_layers(sources.file, chain, layers);
  for (const fs::path& file : sources.layers) collect_layers(file, chain, layers);
  for (const std::string& assignment : sources.overrides)
    layers.push_back(override_layer(assignment));
  for (const KeyFlag& flag : sources.flags) layers.push_back(flag_layer(flag));
  Reader reader(fields, named);
  for (const Layer& layer : layers) reader.apply(layer);
  reader.throw_problems();
}

void read_text(const std::string& yaml, const std::string& name, const FieldList& fields) {
  Reader reader(fields);
  reader.apply({parse(yaml, name), name, fs::current_path(), true});
  reader.throw_problems();
}

}  // namespace jade::config
