// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <future>
#include <torch/types.h>
#include <utility>
#include <vector>

namespace jade::run {

/// Writes pictures beside the calling thread, several at once. The destructor waits for all of
/// them.
class PictureWriter {
 public:
  /// @param max_bytes  of queued images; up to twice as much may be in memory
  explicit PictureWriter(int64_t max_bytes = int64_t(256) << 20) : max_bytes_(max_bytes) {}

  /// @param image  as for imaging::write_image, on any device; copied before this returns
  /// @throws DataError as wait()
  void add(const std::filesystem::path& path, const torch::Tensor& image);
  /// Starts writing the added pictures, after those started before.
  /// @throws DataError as wait()
  void begin();
  /// @throws DataError of a picture that could not be written; others may be missing then
  void wait();

 private:
  std::vector<std::pair<std::filesystem::path, torch::Tensor>> added_;
  int64_t max_bytes_, bytes_ = 0;
  std::future<void> writing_;
};

}  // namespace jade::run
