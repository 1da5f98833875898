// SPDX-License-Identifier: Apache-2.0
// The router's fused operation on the CPU against torch's own convolutions.
#include "support/catch.h"

#include <ATen/Parallel.h>
#include <cmath>
#include <limits>
#include <vector>

#include "jade/core/error.h"
#include "jade/core/random.h"
#include "jade/router/conv_band.h"
#include "jade/router/logits.h"
#include "jade/router/router.h"
#include "support/gradcheck.h"

namespace jade::router {
namespace {

torch::Tensor drawn_input(int64_t count, int64_t height, int64_t width, torch::Dtype type) {
  at::Generator generator = make_generator(7, "router input");
  return torch::randn({count, 5, height, width}, generator, torch::kFloat64).to(type);
}

Router drawn_router(torch::Dtype type) {
  Router router(make_generator(3, "router"));
  router->to(type);
  return router;
}

/// The logits, and their gradients by the input and every parameter.
std::vector<torch::Tensor> gradients(Router& router, const torch::Tensor& input, bool fused) {
  router->zero_grad();
  const torch::Tensor leaf = input.clone().set_requires_grad(true);
  const torch::Tensor logits = fused ? router->logits(leaf) : router->logits_by_layers(leaf);
  at::Generator generator = make_generator(8, "cotangent");
  logits.backward(torch::randn(logits.sizes(), generator, torch::kFloat64).to(logits.dtype()));
  std::vector<torch::Tensor> all = {logits.detach(), leaf.grad()};
  for (const torch::Tensor& parameter : router->parameters()) all.push_back(parameter.grad());
  return all;
}

double relative_difference(const torch::Tensor& a, const torch::Tensor& b) {
  return ((a - b).norm() / b.norm()).item<double>();
}

TEST_CASE("router on the CPU: values and gradients are those of torch's layers", "[router]") {
  const std::vector<std::vector<int64_t>> sizes = {{1, 1, 1},  {1, 1, 19},  {2, 9, 1},  {2, 7, 5},
                                                   {1, 8, 16}, {1, 33, 47}, {1, 17, 32}};
  for (const torch::Dtype type : {torch::kFloat64, torch::kFloat32}) {
    Router router = drawn_router(type);
    for (const auto& size : sizes) {
      const torch::Tensor input = drawn_input(size[0], size[1], size[2], type);
      const auto own = gradients(router, input, true);
      const auto torchs = gradients(router, input, false);
      REQUIRE(own.size() == 12);
      for (size_t i = 0; i < own.size(); ++i) {
        INFO("size " << size[1] << "x" << size[2] << ", tensor " << i);
        CHECK(own[i].sizes() == torchs[i].sizes());
        CHECK(own[i].dtype() == type);
        CHECK(relative_difference(own[i], torchs[i]) < (type == torch::kFloat64 ? 1e-12 : 1e-5));
      }
    }
  }
}

TEST_CASE("router on the CPU: gradcheck, and it notices a derivative that is off", "[router]") {
  Router router = drawn_router(torch::kFloat64);
  std::vector<torch::Tensor> inputs = {drawn_input(1, 5, 6, torch::kFloat64)};
  std::vector<std::string> names = {"input"};
  for (const auto& item : router->named_parameters()) {
    inputs.push_back(item.value().detach());
    names.push_back(item.key());
  }
  for (torch::Tensor& input : inputs) input.set_requires_grad(true);
  const auto logits = [](const std::vector<torch::Tensor>& in) {
    // In the order of registration.
    return cpu::router_logits(
        in[0], {in[1], in[2], in[3], in[4], in[5], in[6], in[7], in[8], in[9], in[10]});
  };
  test::GradcheckOptions options;
  options.max_elements = 70;
  const auto report = test::gradcheck(logits, inputs, names, options);
  INFO(report.message);
  CHECK(report.passed);
  CHECK(report.checked > 500);

  const auto broken = [&](const std::vector<torch::Tensor>& in) {
    const torch::Tensor off = 1e-3 * in[3].sum();
    return logits(in) + off - off.detach();
  };
  CHECK_FALSE(test::gradcheck(broken, inputs, names, options).passed);
}

TEST_CASE("router on the CPU: the same bits for any number of threads", "[router]") {
  Router router = drawn_router(torch::kFloat32);
  const torch::Tensor input = drawn_input(1, 75, 61, torch::kFloat32);
  const int threads = at::get_num_threads();
  std::vector<torch::Tensor> first;
  for (const int count : {1, 2, 3, 5, 2}) {
    at::set_num_threads(count);
    const auto now = gradients(router, input, true);
    if (first.empty()) {
      for (const torch::Tensor& tensor : now) first.push_back(tensor.clone());
    }
    for (size_t i = 0; i < now.size(); ++i) CHECK(torch::equal(now[i], first[i]));
  }
  at::set_num_threads(threads);
}

TEST_CASE("router on the CPU: NaN stays visible, and only asked gradients are made", "[router]") {
  Router router = drawn_router(torch::kFloat32);
  torch::Tensor input = drawn_input(1, 9, 9, torch::kFloat32);
  input[0][1][4][4] = std::numeric_limits<float>::quiet_NaN();
  CHECK(std::isnan(router->logits(input)[0][0][4][4].item<float>()));
  input[0][1][4][4] = 0;
  router->head2->weight.set_requires_grad(false);
  router->logits(input).sum().backward();
  CHECK_FALSE(router->head2->weight.grad().defined());
  CHECK(router->event1->weight.grad().defined());
  const torch::NoGradGuard no_grad;
  CHECK_FALSE(router->logits(input).requires_grad());
}

/// One small convolution and its weight gradient, by the selected kernels.
std::vector<float> convolved(int64_t kernel, int64_t width) {
  const ConvKernels<float>& kernels = conv_kernels().single;
  const int64_t height = 5, pad = kernel / 2;
  std::vector<float> memory(
      static_cast<size_t>(Planes<float>{nullptr, 4, height, width, pad}.size()));
  for (size_t i = 0; i < memory.size(); ++i) memory[i] = std::sin(static_cast<float>(i));
  std::vector<float> out(static_cast<size_t>(Planes<float>{nullptr, 5, height, width, 0}.size()));
  std::vector<float> weights(static_cast<size_t>(5 * 4 * kernel * kernel));
  for (size_t i = 0; i < weights.size(); ++i) weights[i] = std::cos(static_cast<float>(i));
  Convolution<float> args;
  args.in = {memory.data(), 4, height, width, pad};
  args.out = {out.data(), 5, height, width, 0};
  args.weights = weights.data();
  args.kernel = kernel;
  args.relu = true;
  kernels.convolve(args, {0, height});
  std::vector<float> sums(weights.size());
  for (int64_t c = 0; c < 5; ++c) {
    for (int64_t y = 0; y < height; ++y) {
      for (int64_t x = width; x < args.out.stride(); ++x) args.out.row(c, y)[x] = 0;
    }
  }
  kernels.weight_gradient({args.in, args.out, kernel}, {0, height}, sums.data(), nullptr);
  out.insert(out.end(), sums.begin(), sums.end());
  return out;
}

TEST_CASE("router on the CPU: every instruction set gives the portable convolutions", "[router]") {
  std::vector<float> plain, fused;
  for (const kernel::Isa isa : kernel::kIsas) {
    if (!kernel::can_run(isa)) continue;
    INFO(kernel::name(isa));
    const kernel::ForcedIsa forced(isa);
    CHECK((&conv_kernels() == &portable::kConvKernels) == (isa == kernel::Isa::kPortable));
    std::vector<float> now = convolved(3, 21);
    // Widths that end in the first and in the second half of the widest step.
    for (const int64_t width : {37, 61}) {
      const std::vector<float> more = convolved(5, width);
      now.insert(now.end(), more.begin(), more.end());
    }
    if (isa == kernel::Isa::kPortable) plain = now;
    if (isa == kernel::Isa::kAvx2) fused = now;
    if (isa == kernel::Isa::kAvx512) CHECK(now == fused);
    REQUIRE(now.size() == plain.size());
    float largest = 0, most = 0;
    for (size_t i = 0; i < now.size(); ++i) {
      largest = std::max(largest, std::abs(now[i] - plain[i]));
      most = std::max(most, std::abs(now[i]));
    }
    CHECK(most > 1);
    CHECK(largest < 1e-5f * most);
  }
}

}  // namespace
}  // namespace jade::router
