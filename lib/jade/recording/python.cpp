// SPDX-License-Identifier: Apache-2.0
#include "jade/recording/python.h"

#include <cstdlib>

#include "jade/core/asset.h"

namespace jade::recording {

namespace fs = std::filesystem;

fs::path script(const std::string& name) { return asset("scripts/" + name); }

std::string interpreter(const fs::path& given) {
  if (!given.empty()) return given.string();
  if (const char* const set = std::getenv("JADE_PYTHON"); set != nullptr && *set != '\0')
    return set;
  // A build folder links to the scripts of the source tree, where scripts/setup.sh creates .venv.
  std::error_code ignored;
  const fs::path scripts = fs::weakly_canonical(script("read_recording.py"), ignored).parent_path();
  const fs::path own = scripts.parent_path() / ".venv/bin/python";
  return fs::exists(own, ignored) ? own.string() : "python3";
}

}  // namespace jade::recording
