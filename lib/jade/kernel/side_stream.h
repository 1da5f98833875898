// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>

namespace jade::kernel {

/// Runs work on a second GPU stream, concurrently with the current one; suitable for short kernels
/// of few blocks. Can be captured in a CUDA graph, and can be nested. On the CPU, run() executes
/// its work immediately.
///
/// Memory that one stream allocates and the other reads must live until join() has been called.
class SideStream {
 public:
  /// @param device  index of the GPU; negative: the CPU
  explicit SideStream(int device);
  /// Calls join().
  ~SideStream();
  SideStream(const SideStream&) = delete;
  SideStream& operator=(const SideStream&) = delete;

  /// Makes later work of run() wait for all work queued so far on the constructor's stream. Call it
  /// before the first run().
  void follow();

  /// Calls `work`; the kernels that it queues run on the side stream. In a captured graph, the
  /// stream that queues first starts first.
  void run(const std::function<void()>& work);

  /// True between follow() and join(); always false on the CPU.
  bool apart() const;

  /// Makes later work of the constructor's stream wait for all work queued by run().
  void join();

 private:
  struct Streams;
  std::unique_ptr<Streams> streams_;  ///< null on the CPU
};

}  // namespace jade::kernel
