// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "jade/core/error.h"

namespace jade::data {

/// Collects one line for each problem that a loader could work around.
class Warnings {
 public:
  explicit Warnings(std::vector<std::string>* lines) : lines_(lines) {}

  template <class... Args>
  void add(const Args&... args) const {
    if (lines_ != nullptr) lines_->push_back(concat(args...));
  }

 private:
  std::vector<std::string>* lines_;
};

}  // namespace jade::data
