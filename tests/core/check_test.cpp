// SPDX-License-Identifier: Apache-2.0
#include "jade/core/check.h"

#include "support/catch.h"

#include <torch/types.h>

namespace jade {
namespace {

TEST_CASE("check_shape: names the tensor, what was expected and what was found", "[core]") {
  const auto image = torch::zeros({3, 4, 5});
  CHECK_NOTHROW(check_shape(image, "image", {3, -1, 5}));
  CHECK_THROWS_WITH(check_shape(image, "image", {3, 4}),
                    "image: expected shape [3, 4], found [3, 4, 5]");
  CHECK_THROWS_WITH(check_shape(image, "image", {3, -1, 6}),
                    "image: expected shape [3, any, 6], found [3, 4, 5]");
  CHECK_THROWS_AS(check_shape(torch::Tensor(), "image", {1}), ContractError);
}

}  // namespace
}  // namespace jade
