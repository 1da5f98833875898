// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "jade/sweep/plan.h"

namespace jade::apps {

/// Resolves settings of jade_train from layers of files and overrides, with jade_train's checks.
/// @throws ConfigError with the problems of all layers that cannot be read.
sweep::Resolved resolve_training(const std::vector<config::Sources>& layers);

/// Resolves a file that a sweep wrote, possibly with an older version: absent keys have their
/// printed values, as in a run's own settings.
sweep::Resolved resolve_written(const std::vector<config::Sources>& layers);

}  // namespace jade::apps
