// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <torch/types.h>

namespace jade::imaging {

/// The program that makes films, on PATH. @throws ConfigError that says how to get it.
std::filesystem::path find_ffmpeg();

/// An .mp4 (H.264) made by the program ffmpeg, which gets raw frames through a pipe. The file
/// appears under its name once finish() has returned; without finish(), nothing stays.
class Movie {
 public:
  /// @param width, height  of every frame; odd sizes lose their last column or row
  /// @throws ConfigError where no ffmpeg is on PATH, DataError where it cannot be started.
  Movie(const std::filesystem::path& path, int64_t width, int64_t height, double frames_per_second);
  ~Movie();
  Movie(const Movie&) = delete;
  Movie& operator=(const Movie&) = delete;

  /// @param image  [3,H,W] in [0,1]; values beyond are clamped
  /// @throws DataError for another size, or when ffmpeg stopped.
  void add(const torch::Tensor& image);

  /// @throws DataError when ffmpeg reports an error.
  void finish();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace jade::imaging
