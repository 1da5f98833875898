// SPDX-License-Identifier: Apache-2.0
#include "jade/core/freed_memory.h"

#include "support/catch.h"

#include <cstdint>
#include <cstring>
#include <malloc.h>
#include <memory>
#include <optional>
#include <sys/resource.h>
#include <vector>

namespace jade {
namespace {

/// Page faults of 160 MiB in blocks, written and freed.
int64_t faults_of_round() {
  const auto faults = [] {
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    return int64_t(usage.ru_minflt);
  };
  const int64_t before = faults();
  constexpr size_t kBytes = 16 << 20;
  std::vector<std::unique_ptr<char[]>> blocks;
  for (int i = 0; i < 10; ++i) {
    blocks.emplace_back(new char[kBytes]);
    std::memset(blocks.back().get(), i + 1, kBytes);
  }
  blocks.clear();
  return faults() - before;
}

}  // namespace

TEST_CASE("freed memory: what is kept is not taken page by page again, and goes back at the end",
          "[core]") {
#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__)
  constexpr int64_t kPages = 160 << 8;
  std::optional<FreedMemoryKept> kept(std::in_place);
  faults_of_round();
  CHECK(faults_of_round() < kPages / 10);
  kept.reset();
  CHECK(faults_of_round() > kPages / 2);
  CHECK(faults_of_round() > kPages / 2);
#endif
}

}  // namespace jade
