// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "jade/simulate/scene.h"

namespace jade::simulate {

/// "desk", "workshop", … ; the last ones, "gallery" and "clutter", are meant for training image
/// restorers only, so that a restorer never meets a demo or benchmark scene.
std::vector<std::string> scene_names();

/// Builds a scene; another seed gives other things in other places.
/// @throws ConfigError for an unknown name.
Scene make_scene(const std::string& name, uint64_t seed);

namespace scenes {
Scene desk(uint64_t seed);
Scene workshop(uint64_t seed);
Scene bookshelf(uint64_t seed);
Scene corridor(uint64_t seed);
Scene garden(uint64_t seed);
Scene market(uint64_t seed);
Scene gallery(uint64_t seed);
Scene clutter(uint64_t seed);
}  // namespace scenes

}  // namespace jade::simulate
