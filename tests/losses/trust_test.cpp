// SPDX-License-Identifier: Apache-2.0
#include "jade/losses/trust.h"

#include <torch/types.h>

#include "loss_cases.h"

namespace jade::losses {
namespace {

TEST_CASE("trust: below the bound the value with its gradient, from it on 0 without", "[losses]") {
  for (const double distance : {0.049, 0.05}) {
    torch::Tensor value = torch::tensor(distance, torch::kFloat64).set_requires_grad(true);
    const torch::Tensor kept = where_agreed(value, 0.05);
    kept.backward();
    const bool agrees = distance < 0.05;
    CHECK(kept.item<double>() == (agrees ? distance : 0));
    CHECK(value.grad().item<double>() == (agrees ? 1 : 0));
  }
}

}  // namespace
}  // namespace jade::losses
