// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/regularization.h"

#include "support/catch.h"

#include <torch/types.h>

using namespace jade;
using torch::Tensor;

TEST_CASE("mcmc: the regularization is the weighted means of opacity and scale", "[gaussians]") {
  const Tensor logits = torch::tensor({0.0, -1.0, 2.0}, torch::kFloat64).requires_grad_();
  const Tensor scales =
      torch::tensor({{0.0, 1.0, -1.0}, {-2.0, 0.0, 0.5}, {-3.0, -4.0, 0.1}}, torch::kFloat64)
          .requires_grad_();
  const Tensor value = gaussians::mean_opacity_and_scale(logits, scales, 0.2, 0.3);
  const Tensor opacities = 1 / (1 + (-logits.detach()).exp());
  const Tensor sizes = scales.detach().exp();
  CHECK(value.item<double>() ==
        Approx(0.2 * opacities.mean().item<double>() + 0.3 * sizes.mean().item<double>()));
  value.backward();
  CHECK(torch::allclose(logits.grad(), 0.2 / 3 * opacities * (1 - opacities)));
  CHECK(torch::allclose(scales.grad(), 0.3 / 9 * sizes));
}
