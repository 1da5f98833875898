// SPDX-License-Identifier: Apache-2.0
#include "jade/import/options.h"

#include "jade/core/error.h"

namespace jade::import {

void validate(const ImportOptions& options) {
  if (options.time.end_s != 0 && options.time.end_s <= options.time.begin_s) {
    throw ConfigError(concat("time.end_s: expected 0 or more than time.begin_s (",
                             options.time.begin_s, "), found ", options.time.end_s));
  }
  if (options.test.every == 1) {
    throw ConfigError(
        "test.every: expected 0 or at least 2, found 1, which holds out every exposure");
  }
}

}  // namespace jade::import
