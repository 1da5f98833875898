// SPDX-License-Identifier: Apache-2.0
#include "jade/core/asset.h"

namespace jade {

namespace fs = std::filesystem;

fs::path asset(const std::string& name) {
  std::error_code ignored;
  const fs::path program = fs::read_symlink("/proc/self/exe", ignored);
  const fs::path installed = program.parent_path().parent_path() / "share" / "jade" / name;
  return fs::is_regular_file(installed, ignored) ? installed : fs::path(JADE_ASSETS) / name;
}

}  // namespace jade
