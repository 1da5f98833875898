// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>

namespace jade::kernel {

/// Work on a GPU beside that of the current stream: short kernels of few blocks leave room for
/// others. May be recorded in a CUDA graph, and may be used on a side stream again. On the CPU all
/// runs where it is called.
///
/// Memory: what one stream allocates and the other reads must live until join() has been called.
class SideStream {
 public:
  /// @param device  index of the GPU; below 0: the CPU
  explicit SideStream(int device);
  /// Calls join().
  ~SideStream();
  SideStream(const SideStream&) = delete;
  SideStream& operator=(const SideStream&) = delete;

  /// What run() queues from now on runs after all that the current stream of the constructor was
  /// given before. To be called before the first run().
  void follow();

  /// Calls `work`. What it queues runs on the side stream. Of a recorded step the stream that
  /// queues first starts first.
  void run(const std::function<void()>& work);

  /// Whether follow() has been called, and join() has not since; never for the CPU.
  bool apart() const;

  /// What the constructor's stream is given from now on runs after all that run() has queued.
  void join();

 private:
  struct Streams;
  std::unique_ptr<Streams> streams_;  ///< null for the CPU
};

}  // namespace jade::kernel
