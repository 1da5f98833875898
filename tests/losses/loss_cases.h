// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "support/catch.h"

#include <functional>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/core/random.h"
#include "support/gradcheck.h"

namespace jade::losses::test {

using Loss = std::function<torch::Tensor(const std::vector<torch::Tensor>&)>;

/// A double image in [0.1, 0.9], another for every seed.
inline torch::Tensor image(uint64_t seed, std::vector<int64_t> shape = {3, 7, 9}) {
  at::Generator generator = make_generator(seed, "loss test");
  return at::rand(shape, generator, torch::kFloat64) * 0.8 + 0.1;
}

/// Checks that gradients equal central differences, and that the check detects a derivative 10 %
/// off.
inline void check_gradients(const Loss& loss, std::vector<torch::Tensor> inputs,
                            const std::vector<std::string>& names) {
  for (torch::Tensor& input : inputs) input = input.clone().set_requires_grad(true);
  const auto report = jade::test::gradcheck(loss, inputs, names);
  INFO(report.message);
  CHECK(report.passed);
  const Loss broken = [&](const std::vector<torch::Tensor>& in) {
    const torch::Tensor value = loss(in);
    return value + 0.1 * (value - value.detach());
  };
  CHECK_FALSE(jade::test::gradcheck(broken, inputs, names).passed);
}

}  // namespace jade::losses::test
