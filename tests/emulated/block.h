// SPDX-License-Identifier: Apache-2.0
// A grid of CUDA threads on one CPU thread: blocks run one after the other, and the threads of a
// block are fibers that switch at barriers and warp operations.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>

namespace jade::emulated {

struct Index {
  unsigned x = 1, y = 1, z = 1;
  Index(unsigned x_ = 1, unsigned y_ = 1, unsigned z_ = 1) : x(x_), y(y_), z(z_) {}
};

/// Order in which the threads of a block run between two barriers. Results must not depend on it: a
/// missing barrier causes a difference between orders.
enum class Order { kAscending, kDescending, kShuffled };

/// Sets the order of later launches during the object's lifetime.
class ForcedOrder {
 public:
  explicit ForcedOrder(Order order);
  ~ForcedOrder();
  ForcedOrder(const ForcedOrder&) = delete;
  ForcedOrder& operator=(const ForcedOrder&) = delete;

 private:
  Order before_;
};

/// The barrier or operation at which threads meet: all must be at the same.
enum class Meeting { kBlock, kWarp, kBallot, kMatch, kShuffle, kReduce };

/// Runs `kernel` once for every thread of every block.
/// @param shared_bytes  size of shared_memory(), which contains the same garbage at the start of
///   every block
/// @throws std::logic_error if threads wait at barriers that the others never reach, or meet at
///   different ones. Such a kernel is wrong on a GPU too.
void run_grid(const Index& grid, const Index& block, const std::function<void()>& kernel,
              size_t shared_bytes = 0);

/// @name For code inside run_grid()
/// @{
const Index& grid_size();
const Index& block_size();
const Index& block_index();   ///< from 0
const Index& thread_index();  ///< from 0

void* shared_memory();

/// Values that threads exchange at a barrier, indexed by their position in the block or warp. Valid
/// until the thread's next barrier.
struct Brought {
  const uint64_t* values;     ///< 0 for threads that have returned
  const uint8_t* were_there;  ///< 1 or 0
  unsigned count;
};

/// Waits for all threads of the block that have not returned.
Brought meet_block(uint64_t mine);

/// Synchronises the 32 threads of the warp; the mask must name them all.
Brought meet_warp(Meeting meeting, uint32_t mask, uint64_t mine);
/// @}

}  // namespace jade::emulated
