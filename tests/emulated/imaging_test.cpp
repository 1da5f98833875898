// SPDX-License-Identifier: Apache-2.0
// CUDA kernels of imaging, run thread by thread on the CPU, against its CPU code.
#include "support/catch.h"

#include <torch/types.h>

#include "emulated/block.h"

#define cuda emulated_cuda
#include "jade/imaging/color_kernels.h"
#include "jade/imaging/ssim_kernels.h"
#undef cuda

using namespace jade;
using namespace jade::imaging;
using emulated::ForcedOrder;
using emulated::Order;
using torch::Tensor;

namespace {

/// Three terms of five pairs, with every choice of gradients and of what is prepared.
SsimBatch batch_of(int64_t height, int64_t width) {
  SsimBatch batch;
  for (int i = 0; i < 5; ++i) {
    const int64_t channels = i % 2 == 0 ? 3 : 1;
    SsimPair pair;
    pair.a = torch::rand({channels, height, width});
    pair.b = torch::rand({channels, height, width});
    if (i == 1) {
      pair.mean_b = torch::empty_like(pair.b);
      pair.square_b = torch::empty_like(pair.b);
      cpu::window_means(pair.b, pair.mean_b, pair.square_b);
    }
    pair.grad_a = i != 3;
    pair.grad_b = i == 2 || i == 3;
    batch.pairs.push_back(pair);
  }
  batch.terms = {{2, 1, {}}, {1, 0.5, torch::tensor(0.25f)}, {2, 2, {}}};
  batch.weights = {0.3, -0.3, 0.7};
  return batch;
}

}  // namespace

TEST_CASE("emulated cuda: SSIM, L1 and their gradients are the CPU's", "[emulated]") {
  for (const auto& [height, width] : {std::pair{21, 34}, {1, 1}, {9, 70}, {40, 5}}) {
    torch::manual_seed(3);
    const SsimBatch batch = batch_of(height, width);
    const SsimUpstream upstream{torch::tensor(3.0f), torch::tensor({1.0f, -2.0f, 0.5f})};
    const SsimValues cpu = cpu::similarity(batch);
    const auto expected = cpu::similarity_gradients(batch, cpu.kept, upstream);
    for (const Order order : {Order::kAscending, Order::kDescending}) {
      INFO(height << " x " << width << ", order " << static_cast<int>(order));
      const ForcedOrder forced(order);
      const SsimValues cuda = emulated_cuda::similarity(batch);
      CHECK(torch::allclose(cuda.terms, cpu.terms, 1e-5, 1e-6));
      CHECK(torch::allclose(cuda.total, cpu.total, 1e-5, 1e-6));
      const auto gradients = emulated_cuda::similarity_gradients(batch, cuda.kept, upstream);
      REQUIRE(gradients.size() == expected.size());
      for (size_t i = 0; i < expected.size(); ++i) {
        INFO("gradient " << i);
        REQUIRE(gradients[i].defined() == expected[i].defined());
        if (!expected[i].defined()) continue;
        const double scale = expected[i].abs().max().item<double>();
        CHECK((gradients[i] - expected[i]).abs().max().item<double>() < 2e-3 * scale);
      }
    }
  }
}

TEST_CASE("emulated cuda: gray and its gradient are the CPU's", "[emulated]") {
  for (const auto type : {torch::kFloat32, torch::kFloat64}) {
    const Tensor rgb = torch::rand({2, 3, 13, 29}, type),
                 of_gray = torch::rand({2, 1, 13, 29}, type);
    Tensor gray = torch::empty_like(of_gray), gray_cpu = torch::empty_like(of_gray);
    emulated_cuda::gray(rgb, gray);
    cpu::gray(rgb, gray_cpu);
    CHECK(torch::allclose(gray, gray_cpu));
    Tensor of_rgb = torch::empty_like(rgb), of_rgb_cpu = torch::empty_like(rgb);
    emulated_cuda::gray_gradient(of_gray, of_rgb);
    cpu::gray_gradient(of_gray, of_rgb_cpu);
    CHECK(torch::allclose(of_rgb, of_rgb_cpu));
  }
}
