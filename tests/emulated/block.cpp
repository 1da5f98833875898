// SPDX-License-Identifier: Apache-2.0
#include "emulated/block.h"

#include <algorithm>
#include <cstring>
#include <memory>
#include <numeric>
#include <random>
#include <stdexcept>
#include <ucontext.h>
#include <vector>

// Bounds of the shared memory of all emulated kernels, set by the linker (language.h); null if
// none.
extern "C" char __start_emulated_shared[] __attribute__((weak));
extern "C" char __stop_emulated_shared[] __attribute__((weak));

namespace jade::emulated {

namespace {

constexpr int kGarbage = 0xcd;

constexpr size_t kStackBytes = 256 << 10;
constexpr unsigned kWarp = 32;

Order current_order = Order::kAscending;

/// Threads that wait for each other: a block or a warp.
struct Group {
  unsigned first = 0, size = 0;
  unsigned alive = 0, waiting = 0;
  Meeting meeting = Meeting::kBlock;
  int turn = 0;  ///< index into `brought`, so that a thread that continues early overwrites nothing
  std::vector<uint64_t> brought[2];
  std::vector<uint8_t> were_there[2];
};

struct Fiber {
  ucontext_t context{};
  std::unique_ptr<char[]> stack;
  Index index;
  bool done = false;
  Group* waits_for = nullptr;
};

class Block;
Block* running = nullptr;

class Block {
 public:
  Block(const Index& grid, const Index& size, const std::function<void()>& kernel,
        size_t shared_bytes)
      : grid_(grid),
        size_(size),
        kernel_(kernel),
        fibers_(size.x * size.y * size.z),
        shared_((shared_bytes + sizeof(Aligned) - 1) / sizeof(Aligned)) {
    for (Fiber& fiber : fibers_) fiber.stack.reset(new char[kStackBytes]);
    order_.resize(fibers_.size());
    std::iota(order_.begin(), order_.end(), 0u);
  }

  void run(const Index& index) {
    index_ = index;
    if (!shared_.empty()) std::memset(shared_.data(), kGarbage, shared_.size() * sizeof(Aligned));
    if (__start_emulated_shared != nullptr) {
      std::memset(__start_emulated_shared, kGarbage,
                  static_cast<size_t>(__stop_emulated_shared - __start_emulated_shared));
    }
    start();
    while (left_ > 0) {
      order_threads();
      bool moved = false;
      for (const unsigned t : order_) {
        if (fibers_[t].done || fibers_[t].waits_for != nullptr) continue;
        moved = true;
        current_ = t;
        swapcontext(&scheduler_, &fibers_[t].context);
        if (failure_) std::rethrow_exception(failure_);
      }
      if (!moved) throw std::logic_error("CUDA threads wait at barriers that others never reach");
    }
  }

  Brought meet(Group& group, Meeting meeting, uint64_t mine) {
    const int turn = group.turn;
    auto& brought = group.brought[turn];
    auto& were_there = group.were_there[turn];
    if (group.waiting == 0) {
      group.meeting = meeting;
      std::fill(brought.begin(), brought.end(), 0);
      std::fill(were_there.begin(), were_there.end(), 0);
    }
    if (group.meeting != meeting) throw std::logic_error("CUDA threads meet at different barriers");
    brought[current_ - group.first] = mine;
    were_there[current_ - group.first] = 1;
    ++group.waiting;
    fibers_[current_].waits_for = &group;
    release(group);
    swapcontext(&fibers_[current_].context, &scheduler_);
    return {brought.data(), were_there.data(), group.size};
  }

  Group& everyone() { return everyone_; }
  Group& warp() { return warps_[current_ / kWarp]; }
  const Index& grid() const { return grid_; }
  const Index& size() const { return size_; }
  const Index& index() const { return index_; }
  const Index& thread() const { return fibers_[current_].index; }
  void* shared() { return shared_.data(); }

 private:
  struct alignas(16) Aligned {
    char bytes[16];
  };

  static void reset(Group* group, unsigned first, unsigned size) {
    group->first = first;
    group->size = group->alive = size;
    group->waiting = 0;
    for (auto& values : group->brought) values.assign(size, 0);
    for (auto& flags : group->were_there) flags.assign(size, 0);
  }

  void start() {
    const auto count = static_cast<unsigned>(fibers_.size());
    left_ = count;
    reset(&everyone_, 0, count);
    warps_.resize((count + kWarp - 1) / kWarp);
    for (unsigned w = 0; w < warps_.size(); ++w) {
      reset(&warps_[w], w * kWarp, std::min(kWarp, count - w * kWarp));
    }
    for (unsigned t = 0; t < count; ++t) {
      Fiber& fiber = fibers_[t];
      fiber.index = Index(t % size_.x, t / size_.x % size_.y, t / size_.x / size_.y);
      fiber.done = false;
      fiber.waits_for = nullptr;
      getcontext(&fiber.context);
      fiber.context.uc_stack.ss_sp = fiber.stack.get();
      fiber.context.uc_stack.ss_size = kStackBytes;
      fiber.context.uc_link = &scheduler_;
      makecontext(&fiber.context, &Block::enter, 0);
    }
  }

  static void enter() {
    Block& block = *running;
    try {
      block.kernel_();
    } catch (...) {
      block.failure_ = std::current_exception();
    }
    block.leave();
  }

  void leave() {
    fibers_[current_].done = true;
    --left_;
    for (Group* group : {&everyone_, &warp()}) {
      --group->alive;
      release(*group);
    }
  }

  /// Lets all waiting threads continue, if none is missing.
  void release(Group& group) {
    if (group.waiting == 0 || group.waiting < group.alive) return;
    for (unsigned t = group.first; t < group.first + group.size; ++t) {
      if (fibers_[t].waits_for == &group) fibers_[t].waits_for = nullptr;
    }
    group.waiting = 0;
    group.turn = 1 - group.turn;
  }

  void order_threads() {
    if (current_order == Order::kAscending) return;
    if (current_order == Order::kShuffled) {
      std::shuffle(order_.begin(), order_.end(), random_);
    } else if (order_.front() == 0) {
      std::reverse(order_.begin(), order_.end());
    }
  }

  Index grid_, size_, index_;
  const std::function<void()>& kernel_;
  std::vector<Fiber> fibers_;
  std::vector<Aligned> shared_;
  std::vector<unsigned> order_;
  Group everyone_;
  std::vector<Group> warps_;
  ucontext_t scheduler_{};
  unsigned current_ = 0;
  size_t left_ = 0;
  std::exception_ptr failure_;
  std::mt19937 random_{1};
};

}  // namespace

ForcedOrder::ForcedOrder(Order order) : before_(current_order) { current_order = order; }
ForcedOrder::~ForcedOrder() { current_order = before_; }

void run_grid(const Index& grid, const Index& size, const std::function<void()>& kernel,
              size_t shared_bytes) {
  Block block(grid, size, kernel, shared_bytes);
  running = &block;
  for (unsigned z = 0; z < grid.z; ++z) {
    for (unsigned y = 0; y < grid.y; ++y) {
      for (unsigned x = 0; x < grid.x; ++x) block.run(Index(x, y, z));
    }
  }
  running = nullptr;
}

const Index& grid_size() { return running->grid(); }
const Index& block_size() { return running->size(); }
const Index& block_index() { return running->index(); }
const Index& thread_index() { return running->thread(); }
void* shared_memory() { return running->shared(); }

Brought meet_block(uint64_t mine) {
  return running->meet(running->everyone(), Meeting::kBlock, mine);
}

Brought meet_warp(Meeting meeting, uint32_t mask, uint64_t mine) {
  if (mask != ~0u) throw std::logic_error("warp operations of a part of a warp are not emulated");
  return running->meet(running->warp(), meeting, mine);
}

}  // namespace jade::emulated
