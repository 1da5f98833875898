// SPDX-License-Identifier: Apache-2.0
#include "jade/core/error.h"

#include "support/catch.h"

namespace jade {
namespace {

TEST_CASE("error: each type carries its documented exit code", "[core]") {
  CHECK(static_cast<int>(ConfigError("").exit_code()) == 2);
  CHECK(static_cast<int>(DataError("").exit_code()) == 3);
  CHECK(static_cast<int>(DeviceError("").exit_code()) == 4);
  CHECK(static_cast<int>(NumericError("").exit_code()) == 5);
  CHECK(static_cast<int>(CheckpointError("").exit_code()) == 6);
  CHECK(static_cast<int>(Interrupted().exit_code()) == 130);
  CHECK(static_cast<int>(ContractError("").exit_code()) == 1);
}

}  // namespace
}  // namespace jade
