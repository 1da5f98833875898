// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <set>
#include <string>

namespace jade::config {

/// Collects all problems of a user's settings in the order they were found, without duplicates, so
/// that a mistake shared by many runs is reported once.
class Problems {
 public:
  /// Adds one problem, or one per line.
  void add(const std::string& lines);

  /// @throws ConfigError with all lines, if there are any.
  void throw_if_any() const;

 private:
  std::set<std::string> seen_;
  std::string all_;
};

}  // namespace jade::config
