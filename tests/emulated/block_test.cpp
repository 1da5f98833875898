// SPDX-License-Identifier: Apache-2.0
// Results of the emulation for correct and for faulty kernels.
#include "emulated/block.h"

#include "support/catch.h"

#include <numeric>
#include <stdexcept>
#include <vector>

using namespace jade::emulated;

namespace {

/// Each thread writes its number and reads its neighbour's.
std::vector<unsigned> neighbours(bool barrier) {
  constexpr unsigned kThreads = 96;
  std::vector<unsigned> shared(kThreads, 1000), read(kThreads);
  run_grid(1, kThreads, [&] {
    const unsigned t = thread_index().x;
    shared[t] = t;
    if (barrier) meet_block(0);
    read[t] = shared[(t + 1) % kThreads];
  });
  return read;
}

}  // namespace

TEST_CASE("run_grid: every thread of every block runs once", "[emulated]") {
  std::vector<int> runs(2 * 3 * 5 * 4);
  run_grid({2, 3}, {5, 4}, [&] {
    const Index &block = block_index(), &thread = thread_index();
    CHECK(block_size().x == 5);
    CHECK(grid_size().y == 3);
    ++runs[((block.y * 2 + block.x) * 4 + thread.y) * 5 + thread.x];
  });
  for (const int count : runs) CHECK(count == 1);
}

TEST_CASE("run_grid: what is written before a barrier is read behind it, in any order",
          "[emulated]") {
  for (const Order order : {Order::kAscending, Order::kDescending, Order::kShuffled}) {
    const ForcedOrder forced(order);
    const auto read = neighbours(true);
    for (unsigned t = 0; t < read.size(); ++t) CHECK(read[t] == (t + 1) % read.size());
  }
}

TEST_CASE("run_grid: a missing barrier shows as a difference between orders", "[emulated]") {
  const auto ascending = neighbours(false);
  const ForcedOrder forced(Order::kDescending);
  CHECK(neighbours(false) != ascending);
}

TEST_CASE("meet_warp: lanes see what the others brought, meeting after meeting", "[emulated]") {
  for (const Order order : {Order::kAscending, Order::kShuffled}) {
    const ForcedOrder forced(order);
    std::vector<uint64_t> sums(40);
    run_grid(1, 40, [&] {
      uint64_t sum = 0;
      for (uint64_t round = 1; round <= 5; ++round) {
        const Brought all = meet_warp(Meeting::kShuffle, ~0u, round * (thread_index().x + 1));
        sum += std::accumulate(all.values, all.values + all.count, uint64_t{0});
      }
      sums[thread_index().x] = sum;
    });
    for (unsigned t = 0; t < 40; ++t) {
      CHECK(sums[t] == 15 * (t < 32 ? 32 * 33 / 2 : 33 + 34 + 35 + 36 + 37 + 38 + 39 + 40));
    }
  }
}

TEST_CASE("meet_block: threads that have returned are not waited for", "[emulated]") {
  unsigned there = 0;
  run_grid(1, 64, [&] {
    if (thread_index().x >= 40) return;
    const Brought all = meet_block(1);
    if (thread_index().x == 0) there = std::accumulate(all.were_there, all.were_there + 64, 0u);
  });
  CHECK(there == 40);
}

TEST_CASE("run_grid: barriers that a part of the threads never reaches are an error",
          "[emulated]") {
  CHECK_THROWS_AS(run_grid(1, 64,
                           [] {
                             if (thread_index().x < 16) {
                               meet_warp(Meeting::kWarp, ~0u, 0);
                             } else {
                               meet_block(0);
                             }
                           }),
                  std::logic_error);
  CHECK_THROWS_AS(run_grid(1, 32,
                           [] {
                             const bool low = thread_index().x < 16;
                             meet_warp(low ? Meeting::kBallot : Meeting::kShuffle, ~0u, 0);
                           }),
                  std::logic_error);
  CHECK_THROWS_AS(run_grid(1, 32, [] { meet_warp(Meeting::kWarp, 0xffff, 0); }), std::logic_error);
}

TEST_CASE("run_grid: an error of a kernel comes out", "[emulated]") {
  CHECK_THROWS_AS(run_grid(3, 40,
                           [] {
                             meet_block(0);
                             if (block_index().x == 1) throw std::runtime_error("kernel");
                           }),
                  std::runtime_error);
}
