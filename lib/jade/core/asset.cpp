// SPDX-License-Identifier: Apache-2.0
#include "jade/core/asset.h"

#include <cstdlib>

namespace jade {

namespace fs = std::filesystem;

fs::path asset(const std::string& name) {
  std::error_code ignored;
  const fs::path program = fs::read_symlink("/proc/self/exe", ignored);
  fs::path installed = program.parent_path().parent_path() / "share" / "jade" / name;
  if (fs::is_regular_file(installed, ignored)) return installed;
  if (const char* const folder = std::getenv("JADE_DATA"); folder != nullptr && *folder != '\0') {
    if (fs::path given = fs::path(folder) / name; fs::is_regular_file(given, ignored)) return given;
  }
  return installed;
}

}  // namespace jade
