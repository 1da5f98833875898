// SPDX-License-Identifier: Apache-2.0
#include "jade/train/row_adam.h"

#include "support/catch.h"

#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/train/module_adam.h"
#include "train/bench.h"

using namespace jade;

namespace {

/// A parameter of three rows under RowAdam, with given gradients.
struct Rows {
  torch::Tensor parameter;
  train::RowAdam adam;

  explicit Rows(uint64_t seed = 5) {
    torch::manual_seed(seed);
    parameter = torch::randn({3, 2, 6}, torch::kFloat64).requires_grad_();
    adam = train::RowAdam(parameter);
  }
  /// Adds a gradient of row `row` only.
  void see(int64_t row, double size) {
    torch::Tensor gradient = torch::zeros({3, 2, 6}, torch::kFloat64);
    gradient[row].copy_(size * torch::linspace(-1, 2, 12, torch::kFloat64).view({2, 6}));
    parameter.mutable_grad() = gradient;
    adam.accumulate(torch::tensor({row}, torch::kInt64));
    parameter.mutable_grad() = torch::Tensor();
  }
  torch::Tensor row(int64_t i) const { return parameter.detach()[i].clone(); }
};

}  // namespace

TEST_CASE("row Adam: each row steps as an Adam of its own would", "[train]") {
  Rows rows;
  torch::Tensor alone = rows.row(1).requires_grad_();
  train::ModuleAdam expected({alone}, 0.1);
  for (int step = 0; step < 5; ++step) {
    rows.see(1, 0.3 + step);
    rows.adam.update(0.1);
    alone.mutable_grad() = (0.3 + step) * torch::linspace(-1, 2, 12, torch::kFloat64).view({2, 6});
    expected.step();
    // Steps of other rows in between change nothing.
    rows.see(2, 1);
    rows.adam.update(0.1);
  }
  CHECK((rows.row(1) - alone.detach()).abs().max().item<double>() < 1e-14);
  CHECK(rows.adam.state().steps.equal(torch::tensor({0.0, 5.0, 5.0}, torch::kFloat64)));
}

TEST_CASE("row Adam: a row that no step saw stays to the bit, with moments from before or without",
          "[train]") {
  Rows rows;
  rows.see(0, 1);
  rows.adam.update(0.1);
  const torch::Tensor once = rows.row(0), never = rows.row(2);
  const train::RowAdamState& state = rows.adam.state();
  const torch::Tensor first = state.first[0].clone(), second = state.second[0].clone();
  for (int step = 0; step < 4; ++step) {
    rows.see(1, 2);
    rows.adam.update(0.1);
  }
  CHECK(rows.row(0).equal(once));
  CHECK(state.first[0].equal(first));
  CHECK(state.second[0].equal(second));
  CHECK(rows.row(2).equal(never));
}

TEST_CASE("row Adam: gradients wait and add up until the update, which leaves none", "[train]") {
  Rows added(5), once(5);
  added.see(0, 1);
  added.see(0, 2);
  added.see(1, 1);
  CHECK(added.adam.state().seen.equal(torch::tensor({2, 1, 0}, torch::kInt64)));
  CHECK(added.row(0).equal(once.row(0)));
  added.adam.update(0.1);
  once.see(0, 3);
  once.see(1, 1);
  once.adam.update(0.1);
  CHECK((added.row(0) - once.row(0)).abs().max().item<double>() < 1e-15);
  CHECK(added.row(1).equal(once.row(1)));
  const torch::Tensor rest = added.row(0);
  added.adam.update(0.1);
  CHECK(added.row(0).equal(rest));
}

TEST_CASE("row Adam: goes on from its state to the bit, with gradients that wait", "[train]") {
  Rows whole(5), resumed(5);
  whole.see(0, 1);
  whole.see(1, 2);
  whole.adam.update(0.1);
  whole.see(1, 3);
  {
    const torch::NoGradGuard no_grad;
    resumed.parameter.copy_(whole.parameter);
  }
  auto target = test::tensors_of(resumed.adam);
  for (const auto& [name, tensor] : test::tensors_of(whole.adam)) target.at(name).copy_(tensor);
  for (Rows* each : {&whole, &resumed}) {
    each->see(2, 1);
    each->adam.update(0.1);
  }
  CHECK(resumed.parameter.equal(whole.parameter));
}
