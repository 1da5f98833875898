// SPDX-License-Identifier: Apache-2.0
#include "jade/kernel/isa.h"

#include "support/catch.h"

#include <stdexcept>
#include <string>

#include "jade/core/error.h"

using namespace jade;
using namespace jade::kernel;

namespace {

/// Stands for the kernels of an op.
struct Set {
  int width = 0;
};
constexpr Set kFour{4}, kEight{8}, kSixteen{16};

}  // namespace

TEST_CASE("isa: the best set that runs is chosen; a forced one ends with its scope", "[kernel]") {
  Isa best = Isa::kPortable;
  for (const Isa isa : kIsas) {
    if (can_run(isa)) best = isa;
  }
  CHECK(can_run(Isa::kPortable));
  CHECK(chosen_isa() == best);
  {
    const ForcedIsa portable(Isa::kPortable);
    CHECK(chosen_isa() == Isa::kPortable);
    {
      const ForcedIsa again(best);
      CHECK(chosen_isa() == best);
    }
    CHECK(chosen_isa() == Isa::kPortable);
  }
  CHECK(chosen_isa() == best);
  try {
    const ForcedIsa portable(Isa::kPortable);
    throw std::runtime_error("inside");
  } catch (const std::runtime_error&) {
  }
  CHECK(chosen_isa() == best);
}

TEST_CASE("isa: a set that this machine cannot run is refused by name", "[kernel]") {
  const Isa before = chosen_isa();
  for (const Isa isa : kIsas) {
    if (can_run(isa)) {
      CHECK_NOTHROW(ForcedIsa(isa));
    } else {
      CHECK_THROWS_WITH(ForcedIsa(isa), Catch::Contains(std::string(name(isa))));
    }
    CHECK(chosen_isa() == before);
  }
}

TEST_CASE("isa: an op without kernels of the chosen set takes the next lower", "[kernel]") {
  const IsaTable<Set> all = {&kFour, &kEight, &kSixteen}, two = {&kFour, &kEight}, one = {&kFour};
  const int of_all[] = {4, 8, 16}, of_two[] = {4, 8, 8};
  for (const Isa isa : kIsas) {
    if (!can_run(isa)) continue;
    const ForcedIsa forced(isa);
    CHECK(all.chosen().width == of_all[static_cast<int>(isa)]);
    CHECK(two.chosen().width == of_two[static_cast<int>(isa)]);
    CHECK(one.chosen().width == 4);
  }
}
