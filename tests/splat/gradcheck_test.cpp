// SPDX-License-Identifier: Apache-2.0
#include "support/gradcheck.h"

#include "support/catch.h"

#include <cmath>
#include <torch/csrc/autograd/custom_function.h>

using jade::test::gradcheck;
using torch::Tensor;

namespace {

/// x³ + sin(y), whose derivative by y can be made wrong.
struct Cubic : torch::autograd::Function<Cubic> {
  static Tensor forward(torch::autograd::AutogradContext* ctx, const Tensor& x, const Tensor& y,
                        double error) {
    ctx->save_for_backward({x, y});
    ctx->saved_data["error"] = error;
    return x * x * x + y.sin();
  }
  static torch::autograd::tensor_list backward(torch::autograd::AutogradContext* ctx,
                                               const torch::autograd::tensor_list& g) {
    const auto saved = ctx->get_saved_variables();
    Tensor grad_y = (g[0] * saved[1].cos()).clone();
    grad_y[3] = grad_y[3] * (1 + ctx->saved_data["error"].toDouble());
    return {g[0] * 3 * saved[0] * saved[0], grad_y, Tensor()};
  }
};

jade::test::GradcheckReport check_with_error(double error) {
  const Tensor x = torch::linspace(-1, 2, 7, torch::kFloat64).set_requires_grad(true);
  const Tensor y = torch::linspace(0, 1, 7, torch::kFloat64).set_requires_grad(true);
  return gradcheck([&](const std::vector<Tensor>& in) { return Cubic::apply(in[0], in[1], error); },
                   {x, y}, {"x", "y"});
}

}  // namespace

TEST_CASE("gradcheck: right gradients pass", "[gradcheck]") {
  const auto report = check_with_error(0);
  INFO(report.message);
  CHECK(report.passed);
  CHECK(report.checked == 14);
}

TEST_CASE("gradcheck: one wrong element among many is found and named", "[gradcheck]") {
  const auto report = check_with_error(1e-3);
  CHECK_FALSE(report.passed);
  CHECK(report.message.find("y[3]") == 0);
}

TEST_CASE("gradcheck: a NaN gradient fails", "[gradcheck]") {
  CHECK_FALSE(check_with_error(NAN).passed);
}
