// SPDX-License-Identifier: Apache-2.0
#include "jade/losses/trust.h"

#include <torch/types.h>

namespace jade::losses {

torch::Tensor where_agreed(const torch::Tensor& value, double bound) {
  return value * value.detach().lt(bound);
}

}  // namespace jade::losses
