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

  /// Makes later work of run() wait for all work queued so far on the constructor's stream. Call it
  /// before the first run().
  void follow();

  /// Calls `work`. What it queues runs on the side stream. Of a recorded step the stream that
  /// queues first starts first.
  void run(const std::function<void()>& work);

  /// Whether follow() has been called, and join() has not since; never for the CPU.
  bool apart() const;

  /// Makes later work of the constructor's stream wait for all work queued by run().
  void join();

 private:
  struct Streams;
  std::unique_ptr<Streams> streams_;  ///< null for the CPU
};

}  // namespace jade::kernel
