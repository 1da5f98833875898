// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <set>
#include <string>

namespace jade::config {

/// Collects all problems of a user's settings: lines in the order they were found, each once, so
/// that a mistake shared by many runs is one line.
class Problems {
 public:
  /// One problem, or several lines of them.
  void add(const std::string& lines);

  /// @throws ConfigError with every line, if there is any.
  void throw_if_any() const;

 private:
  std::set<std::string> seen_;
  std::string all_;
};

}  // namespace jade::config
