// SPDX-License-Identifier: Apache-2.0
// Checks of messages by required words, not by sentences.
#pragma once

#include "support/catch.h"

#include <exception>
#include <string>
#include <utility>
#include <vector>

namespace jade::test {

/// Matches a message that contains all of `words`: the keys, files, numbers or flags that it must
/// name. Sentences may be reworded without changing a test.
class Naming : public Catch::MatcherBase<std::string> {
 public:
  explicit Naming(std::vector<std::string> words) : words_(std::move(words)) {}
  bool match(const std::string& text) const override {
    for (const std::string& word : words_) {
      if (text.find(word) == std::string::npos) return false;
    }
    return true;
  }
  std::string describe() const override {
    std::string all = "names";
    for (const std::string& word : words_) all += " \"" + word + "\"";
    return all;
  }

 private:
  std::vector<std::string> words_;
};

template <class... Words>
Naming naming(const Words&... words) {
  return Naming({std::string(words)...});
}

/// Matches an error whose message has all of the words.
class ErrorNaming : public Catch::MatcherBase<std::exception> {
 public:
  explicit ErrorNaming(Naming naming) : naming_(std::move(naming)) {}
  bool match(const std::exception& error) const override { return naming_.match(error.what()); }
  std::string describe() const override { return naming_.describe(); }

 private:
  Naming naming_;
};

}  // namespace jade::test

/// The expression throws an error of `type` that names all of the words.
#define CHECK_THROWS_NAMING(type, expression, ...) \
  CHECK_THROWS_MATCHES(expression, type, jade::test::ErrorNaming(jade::test::naming(__VA_ARGS__)))
