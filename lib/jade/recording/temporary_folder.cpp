// SPDX-License-Identifier: Apache-2.0
#include <cstdlib>
#include <string>

#include "jade/core/error.h"
#include "jade/recording/contents.h"

namespace jade::recording {

TemporaryFolder::TemporaryFolder() {
  std::error_code error;
  const auto parent = std::filesystem::temp_directory_path(error);
  std::string pattern = (parent / "jade-recording-XXXXXX").string();
  if (error || mkdtemp(pattern.data()) == nullptr) {
    throw DataError(concat(pattern,
                           ": no temporary folder can be made; set TMPDIR to a folder "
                           "with space"));
  }
  path_ = pattern;
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

}  // namespace jade::recording
