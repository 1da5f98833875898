// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <torch/types.h>

namespace jade::imaging {

/// Path of ffmpeg, found on PATH. @throws ConfigError that says how to install it.
std::filesystem::path find_ffmpeg();

/// Writes an .mp4 (H.264) with the program ffmpeg, which receives raw frames through a pipe.
/// finish() creates the file; without finish() no file remains.
class Movie {
 public:
  /// @param width, height  of every frame; odd sizes lose their last column or row
  /// @throws ConfigError if there is no ffmpeg on PATH, DataError if it cannot be started.
  Movie(const std::filesystem::path& path, int64_t width, int64_t height, double frames_per_second);
  ~Movie();
  Movie(const Movie&) = delete;
  Movie& operator=(const Movie&) = delete;

  /// @param image  [3,H,W]; values are clamped to [0,1]
  /// @throws DataError for another size, or if ffmpeg has stopped.
  void add(const torch::Tensor& image);

  /// @throws DataError if ffmpeg reports an error.
  void finish();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace jade::imaging
