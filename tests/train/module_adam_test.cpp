// SPDX-License-Identifier: Apache-2.0
#include "jade/train/module_adam.h"

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

using namespace jade;

namespace {

/// The parameter after some steps with changing gradients and step sizes.
torch::Tensor stepped(torch::Device device, torch::Dtype type) {
  torch::Tensor parameter = torch::zeros({2, 3}, torch::TensorOptions(device).dtype(type));
  train::ModuleAdam adam({parameter}, 0.1);
  for (int step = 1; step <= 4; ++step) {
    parameter.mutable_grad() = torch::arange(6, parameter.options()).view({2, 3}) - step;
    adam.step(0.1 / step);
  }
  return parameter.cpu();
}

/// Adam's formula for element `i` of it.
double expected(int i) {
  double value = 0, first = 0, second = 0;
  for (int step = 1; step <= 4; ++step) {
    const double gradient = i - step;
    first = 0.9 * first + 0.1 * gradient;
    second = 0.999 * second + 0.001 * gradient * gradient;
    const double mean = first / (1 - std::pow(0.9, step));
    const double square = second / (1 - std::pow(0.999, step));
    value -= 0.1 / step * mean / (std::sqrt(square) + 1e-8);
  }
  return value;
}

void check_steps(torch::Device device) {
  for (const torch::Dtype type : {torch::kFloat32, torch::kFloat64}) {
    const torch::Tensor found = stepped(device, type).to(torch::kFloat64).flatten();
    for (int i = 0; i < 6; ++i) CHECK(found[i].item<double>() == Approx(expected(i)).margin(1e-6));
  }
}

}  // namespace

TEST_CASE("module adam: steps by Adam's formula in float and double", "[train]") {
  check_steps(torch::kCPU);
}

TEST_CASE("module adam: the same on a GPU", "[train][cuda]") { check_steps(torch::kCUDA); }
