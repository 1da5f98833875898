// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

namespace jade::losses {

/// sg(·): a tensor without gradient. Its only constructor is explicit and detaches, so a
/// stop-gradient of the paper is a parameter type, and forgetting one does not compile.
class Fixed {
 public:
  explicit Fixed(const torch::Tensor& tensor) : value_(tensor.detach()) {}
  const torch::Tensor& operator*() const { return value_; }
  const torch::Tensor* operator->() const { return &value_; }

 private:
  torch::Tensor value_;
};

}  // namespace jade::losses
