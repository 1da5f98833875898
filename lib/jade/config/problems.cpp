// SPDX-License-Identifier: Apache-2.0
#include "jade/config/problems.h"

#include <sstream>

#include "jade/core/error.h"

namespace jade::config {

void Problems::add(const std::string& lines) {
  std::istringstream in(lines);
  for (std::string line; std::getline(in, line);) {
    if (seen_.insert(line).second) all_ += (all_.empty() ? "" : "\n") + line;
  }
}

void Problems::throw_if_any() const {
  if (!all_.empty()) throw ConfigError(all_);
}

}  // namespace jade::config
