// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <memory>
#include <optional>
#include <torch/types.h>

namespace jade::run {

/// Measures how long rendering occupies a device, without waiting for a GPU.
class DrawClock {
 public:
  explicit DrawClock(torch::Device device);
  ~DrawClock();

  void start();
  void stop();
  /// Seconds from the last start() to the following stop(): those of this thread or, if more, of
  /// the GPU. No value before a stop(), and while the GPU is still busy.
  std::optional<double> seconds() const;

 private:
  using Clock = std::chrono::steady_clock;
  struct Marks;

  torch::Device device_;
  std::unique_ptr<Marks> marks_;  ///< on a GPU
  Clock::time_point start_;
  std::optional<double> here_;
};

}  // namespace jade::run
