// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/scenes.h"

#include <utility>

#include "jade/core/error.h"

namespace jade::simulate {
namespace {

struct Entry {
  const char* name;
  Scene (*make)(uint64_t seed);
};

constexpr Entry kScenes[] = {{"desk", scenes::desk},           {"workshop", scenes::workshop},
                             {"bookshelf", scenes::bookshelf}, {"corridor", scenes::corridor},
                             {"garden", scenes::garden},       {"market", scenes::market},
                             {"gallery", scenes::gallery},     {"clutter", scenes::clutter}};

}  // namespace

std::vector<std::string> scene_names() {
  std::vector<std::string> names;
  for (const Entry& entry : kScenes) names.emplace_back(entry.name);
  return names;
}

Scene make_scene(const std::string& name, uint64_t seed) {
  for (const Entry& entry : kScenes) {
    if (name == entry.name) return entry.make(seed);
  }
  std::string known;
  for (const Entry& entry : kScenes) known += std::string(known.empty() ? "" : ", ") + entry.name;
  throw ConfigError(concat("simulate.scene: expected one of ", known, "; found '", name, "'"));
}

}  // namespace jade::simulate
