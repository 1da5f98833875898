// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/noise.h"

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

#include "jade/core/random.h"
#include "jade/gaussians/mcmc.h"

namespace jade::gaussians {
namespace {

constexpr int64_t kMany = 40000;

/// Equal Gaussians at the origin: rotated, with three scales, and a quaternion that is not
/// normalised.
GaussianModel many_equal(torch::Device device, double logit_opacity) {
  splat::Gaussians g;
  const auto rows = [&](const torch::Tensor& row) {
    return row.to(torch::kFloat32).expand({kMany, -1}).contiguous();
  };
  g.means = torch::zeros({kMany, 3});
  g.rotations = rows(torch::tensor({{1.2, 0.4, -0.9, 0.3}}));
  g.log_scales = rows(torch::tensor({{0.5, 0.2, 0.05}}).log());
  g.logit_opacities = torch::full({kMany}, logit_opacity);
  g.sh = torch::zeros({kMany, 16, 3});
  return GaussianModel(g, 1.0, device);
}

torch::Tensor moved(GaussianModel& model, double scale, uint64_t seed = 1) {
  at::Generator generator = make_generator(seed, "noise");
  const torch::Tensor before = model.detached().means.clone();
  add_noise(scale, model, generator);
  return (model.detached().means - before).cpu();
}

TEST_CASE("noise: offsets are normal with covariance (scale damping)^2 Sigma^2", "[gaussians]") {
  GaussianModel model = many_equal(torch::kCPU, -6);
  const torch::Tensor offsets = moved(model, 3).to(torch::kFloat64);
  const splat::Gaussians g = model.detached();
  // Σ from its definition: the sum of a_j a_jᵀ, a_j the axes as world_offsets() turns them.
  const torch::Tensor axes =
      world_offsets(g.rotations.narrow(0, 0, 3), g.log_scales.narrow(0, 0, 3), torch::eye(3))
          .to(torch::kFloat64);
  const torch::Tensor sigma = axes.t().mm(axes);
  const double opacity = 1 / (1 + std::exp(6.0));
  const double gain = 3 / (1 + std::exp(100 * (opacity - 0.005)));
  const torch::Tensor expected = gain * gain * sigma.mm(sigma);
  const torch::Tensor found = offsets.t().mm(offsets) / kMany;
  CHECK((found - expected).abs().max().item<double>() < 0.03 * expected.abs().max().item<double>());
  CHECK(offsets.mean(0).abs().max().item<double>() < 0.02 * gain * 0.25);
  // The kurtosis of a normal variable is 3, of a uniform one 1.8.
  const torch::Tensor x = offsets.select(1, 0);
  CHECK((x.pow(4).mean() / x.pow(2).mean().pow(2)).item<double>() == Approx(3).epsilon(0.05));
}

TEST_CASE("noise: rows differ, steps differ, the same seed gives the same bits", "[gaussians]") {
  GaussianModel a = many_equal(torch::kCPU, -6), b = many_equal(torch::kCPU, -6);
  const torch::Tensor first = moved(a, 1), same = moved(b, 1);
  CHECK(first.equal(same));
  CHECK_FALSE(moved(b, 1, 2).equal(first));
  const torch::Tensor x = first.select(1, 0);
  const torch::Tensor neighbours = x.narrow(0, 1, kMany - 1) * x.narrow(0, 0, kMany - 1);
  CHECK(std::abs(neighbours.mean().item<double>()) < 0.02 * x.pow(2).mean().item<double>());
  at::Generator generator = make_generator(1, "noise");
  add_noise(1, a, generator);
  const torch::Tensor second = a.detached().means.clone();
  add_noise(1, a, generator);
  CHECK_FALSE(torch::allclose(a.detached().means - second, first));
}

TEST_CASE("noise: a Gaussian that is not finite keeps its place", "[gaussians]") {
  GaussianModel model = many_equal(torch::kCPU, -6);
  model.parameters().log_scales.detach()[7][1] = std::nanf("");
  model.parameters().log_scales.detach()[8][1] = 60;
  const torch::Tensor offsets = moved(model, 1);
  CHECK(torch::isfinite(offsets).all().item<bool>());
  CHECK((offsets.narrow(0, 7, 2) == 0).all().item<bool>());
}

TEST_CASE("noise: the CUDA kernel samples the CPU's numbers", "[gaussians][cuda]") {
  GaussianModel here = many_equal(torch::kCPU, -5),
                there = many_equal(torch::Device(torch::kCUDA, 0), -5);
  CHECK(torch::allclose(moved(here, 1), moved(there, 1), 1e-4, 1e-6));
}

}  // namespace
}  // namespace jade::gaussians
