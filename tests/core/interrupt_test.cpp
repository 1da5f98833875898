// SPDX-License-Identifier: Apache-2.0
#include "jade/core/interrupt.h"

#include "support/catch.h"

#include <csignal>

#include "jade/core/error.h"

namespace jade {
namespace {

TEST_CASE("interrupt: a signal sets the flag that long work polls", "[core]") {
  install_interrupt_handlers();
  CHECK_FALSE(interrupt_requested());
  CHECK_NOTHROW(throw_if_interrupted());
  std::raise(SIGTERM);
  CHECK(interrupt_requested());
  CHECK_THROWS_AS(throw_if_interrupted(), Interrupted);
  set_interrupt_requested(false);
}

}  // namespace
}  // namespace jade
