// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "jade/sweep/plan.h"

namespace jade::apps {

/// Settings of jade_train from layers of files and overrides, checked as jade_train would.
/// @throws ConfigError with the problems of all layers that cannot be read.
sweep::Resolved resolve_training(const std::vector<config::Sources>& layers);

/// Resolves a file that a sweep wrote, possibly with an older version: absent keys take the printed
/// values, as in a run's own settings.
sweep::Resolved resolve_written(const std::vector<config::Sources>& layers);

}  // namespace jade::apps
