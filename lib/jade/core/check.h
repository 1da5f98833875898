// SPDX-License-Identifier: Apache-2.0
// Contract checks. They stay on in release builds: bad data must never reach a kernel.
#pragma once

#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/core/error.h"

/// Unless `condition` holds, throws ContractError with the remaining arguments joined.
#define JADE_CHECK(condition, ...)                                                             \
  do {                                                                                         \
    if (!(condition)) {                                                                        \
      throw ::jade::ContractError(::jade::concat(__FILE__, ":", __LINE__, ": ", __VA_ARGS__)); \
    }                                                                                          \
  } while (false)

namespace jade {

/// Throws ContractError unless `tensor` is defined and has the shape; -1 matches any size.
void check_shape(const torch::Tensor& tensor, const std::string& name,
                 const std::vector<int64_t>& shape);

/// Throws ContractError unless `tensor` holds `dtype`.
void check_dtype(const torch::Tensor& tensor, const std::string& name, torch::ScalarType dtype);

/// Throws ContractError unless both tensors live on one device.
void check_same_device(const torch::Tensor& a, const std::string& name_a, const torch::Tensor& b,
                       const std::string& name_b);

/// "[3, 260, 346]".
std::string shape_string(const torch::Tensor& tensor);

}  // namespace jade
