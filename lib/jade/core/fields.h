// SPDX-License-Identifier: Apache-2.0
// One declaration per configuration field. An options struct lists its fields once, in a function
// beside it:
//
//   struct RouteOptions { double lr = 5e-4; };
//   template <class V> void describe(V& v, RouteOptions& o) {
//     v.field("lr", o.lr, "Adam step size of the router", Range{1e-8, 1});
//   }
//
// A field may be an enum with words (core/words.h): files contain the word.
//
// Reading, overrides, printing, the JSON schema and the range checks (config/) use this list, and
// so does the compatibility check of checkpoints. The struct's initialiser is the only default.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <sstream>
#include <string>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "jade/core/auto_number.h"
#include "jade/core/steps.h"
#include "jade/core/words.h"

namespace jade {

/// Closed interval [min, max].
struct Range {
  double min = -std::numeric_limits<double>::infinity();
  double max = std::numeric_limits<double>::infinity();
};

/// A field of an enum type, accessed through its words.
class EnumPointer {
 public:
  struct Entry {
    std::string word, help, old_word;  ///< as in Word
  };

  template <class E>
  explicit EnumPointer(E* value)
      : word_([value] { return word_of(*value); }),
        set_([value](size_t index) { *value = words_of(E{}).at(index).value; }) {
    for (const Word<E>& each : words_of(E{})) {
      entries_.push_back({each.word, each.help, each.old_word});
    }
  }

  const std::vector<Entry>& entries() const { return entries_; }
  std::string word() const { return word_(); }
  /// Assigns the value of entries()[index].
  void set(size_t index) const { set_(index); }

 private:
  std::function<std::string()> word_;
  std::function<void(size_t)> set_;
  std::vector<Entry> entries_;
};

/// Types of a field. Relative paths are resolved against the file that contains them.
using FieldPointer = std::variant<bool*, int*, int64_t*, Steps*, double*, AutoNumber*, AutoCount*,
                                  std::string*, std::filesystem::path*, std::vector<int64_t>*,
                                  std::vector<double>*, std::vector<std::string>*, EnumPointer>;

struct Field {
  std::string key;  ///< dotted, "route.lr"
  FieldPointer value;
  std::string help;
  std::optional<Range> range;
};

struct FieldGroup {
  std::string key;  ///< dotted
  std::string help;
};

/// The fields of an options struct, in the order of their declaration; the `V` of `describe`.
class FieldList {
 public:
  template <class T>
  void field(const std::string& name, T& value, const std::string& help,
             const std::optional<Range>& range = std::nullopt) {
    fields_.push_back({prefix_ + name, pointer_to(value), help, range});
  }

  /// A nested struct, under `name.`.
  template <class Options>
  void group(const std::string& name, Options& options, const std::string& help) {
    groups_.push_back({prefix_ + name, help});
    const std::string outer = prefix_;
    prefix_ += name + ".";
    describe(*this, options);
    prefix_ = outer;
  }

  /// A field or group that older configurations call `old_name`. Both are read, with a warning for
  /// the old one; only the new one is printed.
  void renamed(const std::string& old_name, const std::string& name) {
    renamed_[prefix_ + old_name] = prefix_ + name;
  }

  /// A key of older configurations that has become a constant. Reading accepts only the constant's
  /// value, so that configurations and checkpoints that list every key stay readable.
  /// @param value the constant, or a function that returns it once all fields are read
  template <class T>
  void fixed(const std::string& name, const T& value) {
    if constexpr (std::is_invocable_v<const T&>) {
      fixed_[prefix_ + name] = [value] { return plain_text(value()); };
    } else {
      fixed_[prefix_ + name] = [text = plain_text(value)] { return text; };
    }
  }

  const std::vector<Field>& fields() const { return fields_; }
  const std::vector<FieldGroup>& groups() const { return groups_; }

  /// nullptr when there is no such field.
  const Field* find(const std::string& key) const {
    for (const Field& field : fields_) {
      if (field.key == key) return &field;
    }
    return nullptr;
  }
  /// The current key of a renamed key, with its groups; nullptr for any other.
  const std::string* new_key(const std::string& key) const {
    const auto found = renamed_.find(key);
    return found == renamed_.end() ? nullptr : &found->second;
  }
  /// Returns, as text, the value of a key that fixed() declares; nullptr for any other key.
  const std::function<std::string()>* fixed_value(const std::string& key) const {
    const auto found = fixed_.find(key);
    return found == fixed_.end() ? nullptr : &found->second;
  }
  bool is_group(const std::string& key) const {
    for (const FieldGroup& group : groups_) {
      if (group.key == key) return true;
    }
    return false;
  }

 private:
  template <class T>
  static FieldPointer pointer_to(T& value) {
    if constexpr (std::is_enum_v<T>) {
      return EnumPointer(&value);
    } else {
      return &value;
    }
  }

  template <class T>
  static std::string plain_text(const T& value) {
    std::ostringstream text;
    if constexpr (std::is_same_v<T, Steps>) {
      value.is_share() ? text << value.percent() << '%' : text << int64_t{value};
    } else {
      text << std::boolalpha << value;
    }
    return text.str();
  }

  std::string prefix_;
  std::vector<Field> fields_;
  std::vector<FieldGroup> groups_;
  std::map<std::string, std::string> renamed_;                 // old key to new key, both dotted
  std::map<std::string, std::function<std::string()>> fixed_;  // by dotted key
};

/// The fields of `options`. They point into it, so it must outlive the list.
template <class Options>
FieldList fields_of(Options& options) {
  FieldList list;
  describe(list, options);
  return list;
}

}  // namespace jade
