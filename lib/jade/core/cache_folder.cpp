// SPDX-License-Identifier: Apache-2.0
#include "jade/core/cache_folder.h"

#include <cstdlib>

namespace jade {

std::filesystem::path cache_folder() {
  const auto variable = [](const char* name) {
    const char* value = std::getenv(name);
    return std::filesystem::path(value != nullptr ? value : "");
  };
  if (auto own = variable("JADE_CACHE"); !own.empty()) return own;
  // The XDG specification requires relative paths to be ignored.
  if (auto cache = variable("XDG_CACHE_HOME"); cache.is_absolute()) return cache / "jade";
  const auto home = variable("HOME");
  return (home.empty() ? std::filesystem::temp_directory_path() : home / ".cache") / "jade";
}

}  // namespace jade
