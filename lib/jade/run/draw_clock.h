// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <memory>
#include <optional>
#include <torch/types.h>

namespace jade::run {

/// How long drawing keeps a device from its other work, measured without waiting for a GPU.
class DrawClock {
 public:
  explicit DrawClock(torch::Device device);
  ~DrawClock();

  void start();
  void stop();
  /// Seconds from the last start() to the stop() after it: those of this thread or, where they are
  /// more, of the GPU. Nothing before a stop(), and while the GPU is not through.
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
