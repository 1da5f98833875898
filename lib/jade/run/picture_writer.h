// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <future>
#include <torch/types.h>
#include <utility>
#include <vector>

namespace jade::run {

/// Writes pictures on a thread of its own, while something else goes on. Ends when all are written.
class PictureWriter {
 public:
  /// @param max_bytes  of images that wait; twice as much may be held
  explicit PictureWriter(int64_t max_bytes = int64_t(256) << 20) : max_bytes_(max_bytes) {}

  /// @param image  as imaging::write_image takes it, on any device; copied before this returns
  /// @throws DataError as wait()
  void add(const std::filesystem::path& path, const torch::Tensor& image);
  /// Begins to write what was added, after what was begun before.
  /// @throws DataError as wait()
  void begin();
  /// @throws DataError of the first picture that could not be written; those after it are not.
  void wait();

 private:
  std::vector<std::pair<std::filesystem::path, torch::Tensor>> added_;
  int64_t max_bytes_, bytes_ = 0;
  std::future<void> writing_;
};

}  // namespace jade::run
