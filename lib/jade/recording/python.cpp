// SPDX-License-Identifier: Apache-2.0
#include "jade/recording/python.h"

#include <cstdlib>

namespace jade::recording {

namespace fs = std::filesystem;

fs::path script(const std::string& name) {
  std::error_code ignored;
  const fs::path program = fs::read_symlink("/proc/self/exe", ignored);
  const fs::path installed = program.parent_path().parent_path() / "share" / "jade" / name;
  return fs::is_regular_file(installed, ignored) ? installed : fs::path(JADE_SCRIPTS) / name;
}

std::string interpreter(const fs::path& given) {
  if (!given.empty()) return given.string();
  if (const char* const set = std::getenv("JADE_PYTHON"); set != nullptr && *set != '\0')
    return set;
  const fs::path own = fs::path(JADE_SCRIPTS).parent_path() / ".venv/bin/python";
  std::error_code ignored;
  return fs::exists(own, ignored) ? own.string() : "python3";
}

}  // namespace jade::recording
