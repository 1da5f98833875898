// SPDX-License-Identifier: Apache-2.0
#include "jade/train/options.h"

#include "jade/core/error.h"

namespace jade::train {

void validate(const RunOptions& options) {
  if (options.device.empty())
    throw ConfigError("device: expected auto, cpu, cuda or cuda:N, found nothing");
}

}  // namespace jade::train
