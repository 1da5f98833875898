// SPDX-License-Identifier: Apache-2.0
#include "jade/world/worlds.h"

#include "jade/core/error.h"

namespace jade::world {
namespace {

struct Entry {
  const char* name;
  World (*make)(uint64_t seed);
};

constexpr Entry kScenes[] = {{"desk", worlds::desk},           {"workshop", worlds::workshop},
                             {"bookshelf", worlds::bookshelf}, {"corridor", worlds::corridor},
                             {"garden", worlds::garden},       {"market", worlds::market},
                             {"gallery", worlds::gallery},     {"clutter", worlds::clutter}};

}  // namespace

std::vector<std::string> world_names() {
  std::vector<std::string> names;
  for (const Entry& entry : kScenes) names.emplace_back(entry.name);
  return names;
}

World make_world(const std::string& name, uint64_t seed) {
  for (const Entry& entry : kScenes) {
    if (name == entry.name) return entry.make(seed);
  }
  std::string known;
  for (const Entry& entry : kScenes) known += std::string(known.empty() ? "" : ", ") + entry.name;
  throw ConfigError(concat("simulate.world: expected one of ", known, "; found '", name, "'"));
}

}  // namespace jade::world
