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

TEST_CASE("cuda: the regularization of MCMC and its gradient are the CPU's", "[gaussians][cuda]") {
  torch::manual_seed(3);
  for (const int64_t count : {1, 90000}) {
    const Tensor logits = 2 * torch::randn({count}), scales = torch::randn({count, 3}) - 3;
    std::vector<Tensor> values, of_logits, of_scales;
    for (const torch::Device device : {torch::Device(torch::kCPU), torch::Device(torch::kCUDA)}) {
      const Tensor a = logits.to(device, torch::kFloat32, false, /*copy=*/true).requires_grad_();
      const Tensor b = scales.to(device, torch::kFloat32, false, /*copy=*/true).requires_grad_();
      values.push_back(gaussians::mean_opacity_and_scale(a, b, 0.3, 0.7));
      (2 * values.back()).backward();
      values.back() = values.back().detach().cpu();
      of_logits.push_back(a.grad().cpu());
      of_scales.push_back(b.grad().cpu());
    }
    INFO(count << " Gaussians");
    CHECK(torch::allclose(values[1], values[0], 1e-5, 1e-7));
    CHECK(torch::allclose(of_logits[1], of_logits[0], 1e-4, 1e-10));
    CHECK(torch::allclose(of_scales[1], of_scales[0], 1e-4, 1e-10));
  }
}
