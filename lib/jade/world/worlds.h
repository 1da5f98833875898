// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "jade/world/world.h"

namespace jade::world {

/// "desk", "workshop", …; the last ones, "gallery" and "clutter", are for training image restorers
/// only, so that a restorer never sees a demo or benchmark scene.
std::vector<std::string> world_names();

/// Builds a scene; another seed places other objects elsewhere.
/// @throws ConfigError for an unknown name.
World make_world(const std::string& name, uint64_t seed);

namespace worlds {
World desk(uint64_t seed);
World workshop(uint64_t seed);
World bookshelf(uint64_t seed);
World corridor(uint64_t seed);
World garden(uint64_t seed);
World market(uint64_t seed);
World gallery(uint64_t seed);
World clutter(uint64_t seed);
}  // namespace worlds

}  // namespace jade::world
