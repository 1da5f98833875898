// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "jade/core/log.h"
#include "support/temp_dir.h"
#include "support/tiny_dataset.h"

namespace jade::test {

/// A tiny data set in a folder of its own, with room for runs beside it.
struct TinyScene {
  TempDir dir;
  std::filesystem::path data = dir.path() / "scene";

  explicit TinyScene(const TinyDatasetOptions& options = {}) {
    set_log_level("error");
    write_tiny_dataset(data, options);
  }
};

}  // namespace jade::test
