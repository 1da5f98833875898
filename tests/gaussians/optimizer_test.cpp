// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/optimizer.h"

#include "support/catch.h"

#include <cmath>
#include <torch/optim/adam.h>

#include "jade/core/check.h"
#include "jade/gaussians/adam.h"
#include "jade/kernel/on_cuda.h"
#include "random_gaussians.h"
#include "support/devices.h"

namespace jade::gaussians {
namespace {

using test::random_gaussians;

torch::Tensor gradient_like(const torch::Tensor& value, int64_t step, int index) {
  at::Generator generator = make_generator(static_cast<uint64_t>(step * 10 + index), "gradient");
  const torch::Tensor g = at::randn(value.sizes(), generator, torch::kFloat32);
  return (step % 3 == 0 ? torch::where(g > 0, g, torch::zeros_like(g)) : g).to(value.device());
}

void set_gradients(GaussianModel& model, int64_t step) {
  for (int i = 0; i < kParameterCount; ++i) {
    const torch::Tensor& value = parameter(model.parameters(), i);
    value.mutable_grad() = gradient_like(value, step, i);
  }
}

/// Reference groups with torch's optimiser; dc and rest of SH apart.
struct TorchAdam {
  std::vector<torch::Tensor> values;
  std::unique_ptr<torch::optim::Adam> adam;

  TorchAdam(const splat::Gaussians& g, const OptimOptions& o) {
    const std::vector<double> rates = {0,          o.rotation_lr, o.scale_lr, o.opacity_lr,
                                       o.sh_dc_lr, o.sh_rest_lr};
    values = {g.means,           g.rotations,         g.log_scales,
              g.logit_opacities, g.sh.slice(1, 0, 1), g.sh.slice(1, 1)};
    std::vector<torch::optim::OptimizerParamGroup> groups;
    for (size_t i = 0; i < values.size(); ++i) {
      values[i] = values[i].clone().set_requires_grad(true);
      groups.emplace_back(std::vector<torch::Tensor>{values[i]},
                          std::make_unique<torch::optim::AdamOptions>(
                              torch::optim::AdamOptions(rates[i]).eps(kAdamEps)));
    }
    adam = std::make_unique<torch::optim::Adam>(std::move(groups), torch::optim::AdamOptions(1e-3));
  }

  void step(int64_t step, double position_rate) {
    for (int i = 0; i < 4; ++i) {
      values[size_t(i)].mutable_grad() = gradient_like(values[size_t(i)], step, i);
    }
    const torch::Tensor sh =
        gradient_like(torch::cat({values[4].detach(), values[5].detach()}, 1), step, 4);
    values[4].mutable_grad() = sh.slice(1, 0, 1).contiguous();
    values[5].mutable_grad() = sh.slice(1, 1).contiguous();
    static_cast<torch::optim::AdamOptions&>(adam->param_groups()[0].options()).lr(position_rate);
    adam->step();
  }
};

void compare_with_torch(torch::Device device) {
  OptimOptions options;
  options.position_lr_max_steps = 20;
  const splat::Gaussians start = random_gaussians(1013, 16);
  GaussianModel model(start, 2.5, device);
  GaussianAdam ours(model, options);
  TorchAdam theirs(start, options);
  for (int64_t step = 1; step <= 30; ++step) {
    set_gradients(model, step);
    ours.step(model);
    theirs.step(step, position_lr(options, step) * 2.5);
  }
  const splat::Gaussians g =
      map_parameters(model.detached(), [](const torch::Tensor& v) { return v.cpu(); });
  const auto close = [](const torch::Tensor& a, const torch::Tensor& b) {
    return torch::allclose(a, b, 1e-5, 2e-6);
  };
  CHECK(close(g.means, theirs.values[0]));
  CHECK(close(g.rotations, theirs.values[1]));
  CHECK(close(g.log_scales, theirs.values[2]));
  CHECK(close(g.logit_opacities, theirs.values[3]));
  CHECK(close(g.sh.slice(1, 0, 1), theirs.values[4]));
  CHECK(close(g.sh.slice(1, 1), theirs.values[5]));
  CHECK_FALSE(close(g.sh.slice(1, 1), start.sh.slice(1, 1)));
  CHECK(ours.step_count().item<int64_t>() == 30);
}

TEST_CASE("adam: thirty steps equal torch's Adam on every group", "[gaussians]") {
  compare_with_torch(torch::kCPU);
}

TEST_CASE("adam: the CUDA kernel equals torch's Adam on every group", "[gaussians][cuda]") {
  compare_with_torch(torch::Device(torch::kCUDA, 0));
}

/// Channels with different gradients step by their mean: bit-equal to a single channel.
void compare_with_one_channel(torch::Device device) {
  splat::Gaussians start = random_gaussians(1013, 16);
  start.sh = start.sh.narrow(2, 0, 1).expand({-1, -1, 3}).contiguous();
  GaussianModel tied(start, 2.5, device), expected(start, 2.5, device);
  GaussianAdam tied_adam(tied, {}, true), plain(expected, {});
  const auto is_gray = [](const torch::Tensor& sh) {
    return sh.select(2, 0).equal(sh.select(2, 1)) && sh.select(2, 0).equal(sh.select(2, 2));
  };
  for (int64_t step = 1; step <= 30; ++step) {
    set_gradients(tied, step);
    set_gradients(expected, step);
    torch::Tensor& gradient = expected.parameters().sh.mutable_grad();
    gradient = gradient.mean(2, true).expand({-1, -1, 3}).contiguous();
    tied_adam.step(tied);
    plain.step(expected);
    CHECK(is_gray(tied.parameters().sh));
    CHECK(is_gray(tied_adam.first_moments().sh));
    CHECK(is_gray(tied_adam.second_moments().sh));
  }
  CHECK(torch::allclose(tied.parameters().sh, expected.parameters().sh, 1e-5, 2e-6));
  CHECK(torch::equal(tied.parameters().means, expected.parameters().means));
  CHECK(torch::equal(tied.parameters().log_scales, expected.parameters().log_scales));
}

TEST_CASE("adam: the channels of a monochrome scene step alike, by their mean gradient",
          "[gaussians]") {
  compare_with_one_channel(torch::kCPU);
}

TEST_CASE("adam: the CUDA kernel steps the channels of a monochrome scene alike",
          "[gaussians][cuda]") {
  compare_with_one_channel(torch::Device(torch::kCUDA, 0));
}

TEST_CASE("adam: a launch that CUDA refuses is a DeviceError", "[gaussians][cuda]") {
  const torch::Tensor steps = torch::zeros({1}, torch::dtype(torch::kInt64).device(torch::kCUDA));
  AdamStep step;
  step.step = steps.mutable_data_ptr<int64_t>();
  const torch::Tensor rates = torch::zeros({3}, steps.options().dtype(torch::kFloat64));
  step.rates = rates.mutable_data_ptr<double>();
  step.group_count = 1;
  step.groups[0].count = int64_t{1} << 42;  // more blocks than any grid; none starts
  CHECK_THROWS_AS(kernel::on_cuda("the Adam step", [&] { cuda::adam_step(step); }), DeviceError);
}

TEST_CASE("adam: parameters without gradient and their moments stay as they are", "[gaussians]") {
  GaussianModel model(random_gaussians(9, 16), 1, torch::kCPU);
  GaussianAdam adam(model, {});
  const splat::Gaussians before =
      map_parameters(model.detached(), [](const torch::Tensor& v) { return v.clone(); });
  model.parameters().means.mutable_grad() = torch::ones({9, 3});
  adam.step(model);
  CHECK_FALSE(torch::equal(model.parameters().means, before.means));
  CHECK(torch::equal(model.parameters().sh, before.sh));
  CHECK(adam.second_moments().sh.abs().sum().item<double>() == 0);
}

TEST_CASE("adam: the result does not depend on the number of threads", "[gaussians]") {
  const int threads = torch::get_num_threads();
  std::vector<torch::Tensor> results;
  for (const int count : {1, 2}) {
    torch::set_num_threads(count);
    GaussianModel model(random_gaussians(5000, 16), 1, torch::kCPU);
    GaussianAdam adam(model, {});
    for (int64_t step = 1; step <= 3; ++step) {
      set_gradients(model, step);
      adam.step(model);
    }
    results.push_back(model.parameters().sh.detach());
  }
  torch::set_num_threads(threads);
  CHECK(torch::equal(results[0], results[1]));
}

TEST_CASE("position_lr: log-linear from start to end, constant after", "[gaussians]") {
  OptimOptions options;
  options.position_lr_start = 1.6e-4;  // 3DGS
  CHECK(position_lr(options, 0) == Approx(1.6e-4));
  CHECK(position_lr(options, 75000) == Approx(1.6e-5));
  CHECK(position_lr(options, 150000) == Approx(1.6e-6));
  CHECK(position_lr(options, 200000) == Approx(1.6e-6));
  CHECK(position_lr(options, 25000) == Approx(7.427e-5).epsilon(1e-3));
}

TEST_CASE("active_sh_degree: one more every thousand steps, up to 3", "[gaussians]") {
  CHECK(active_sh_degree(1) == 0);
  CHECK(active_sh_degree(999) == 0);
  CHECK(active_sh_degree(1000) == 1);
  CHECK(active_sh_degree(3000) == 3);
  CHECK(active_sh_degree(100000) == 3);
}

TEST_CASE("adam: gathered rows follow their Gaussians and new ones start from zero",
          "[gaussians]") {
  GaussianModel model(random_gaussians(4, 16), 1, torch::kCPU);
  GaussianAdam adam(model, {});
  set_gradients(model, 1);
  adam.step(model);
  const torch::Tensor before = adam.first_moments().rotations.clone();
  adam.gather_rows(torch::tensor({3, -1, 0}, torch::kInt64));
  const torch::Tensor& after = adam.first_moments().rotations;
  REQUIRE(after.size(0) == 3);
  CHECK(torch::equal(after[0], before[3]));
  CHECK(after[1].abs().sum().item<double>() == 0);
  CHECK(torch::equal(after[2], before[0]));
  CHECK(adam.second_moments().logit_opacities.size(0) == 3);
  CHECK_THROWS_AS(adam.step(model), ContractError);
}

TEST_CASE("gaussian model: lower SH degrees are widened with zeros", "[gaussians]") {
  const splat::Gaussians start = random_gaussians(3, 4);
  const GaussianModel model(start, 1, torch::kCPU);
  CHECK(model.parameters().sh.size(1) == 16);
  CHECK(torch::equal(model.parameters().sh.slice(1, 0, 4), start.sh));
  CHECK(model.parameters().sh.slice(1, 4).abs().sum().item<double>() == 0);
  CHECK(model.parameters().means.requires_grad());
  CHECK_THROWS_AS(GaussianModel(start, 0, torch::kCPU), ContractError);
}

}  // namespace
}  // namespace jade::gaussians
