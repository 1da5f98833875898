// SPDX-License-Identifier: Apache-2.0
// The router's CUDA layers, run thread by thread on the CPU, against torch's convolutions in
// float64 with the same rounding.
#include "support/catch.h"

#include <torch/types.h>

#include "emulated/block.h"

#define cuda emulated_cuda
#include "jade/router/logits.h"
#undef cuda

#include "support/router_reference.h"

using namespace jade;
using emulated::ForcedOrder;
using emulated::Order;
using router::RouterWeights;
using torch::Tensor;

namespace {

std::vector<Tensor*> all_of(RouterWeights& w) {
  return {&w.event1,      &w.event2, &w.image1, &w.image1_bias, &w.image2,
          &w.image2_bias, &w.head1,  &w.head2,  &w.head3,       &w.head3_bias};
}

RouterWeights whole_weights() {
  RouterWeights w;
  const std::vector<std::vector<int64_t>> shapes = {
      {16, 2, 5, 5}, {6, 16, 5, 5}, {10, 3, 5, 5}, {10},          {8, 10, 5, 5},
      {8},           {9, 17, 3, 3}, {24, 9, 3, 3}, {1, 24, 1, 1}, {1}};
  const auto members = all_of(w);
  for (size_t i = 0; i < shapes.size(); ++i) *members[i] = router::whole(-1, 1, shapes[i]);
  return w;
}

/// Logits, then the gradients of the weights, of the frame and of Ψ(V).
template <class Forward>
std::vector<Tensor> pass(RouterWeights w, const Tensor& input, const Tensor& cotangent,
                         torch::ScalarType type, const Forward& forward) {
  const auto leaf = [&](const Tensor& t) {
    return t.detach().to(type).clone().set_requires_grad(true);
  };
  for (Tensor* member : all_of(w)) *member = leaf(*member);
  const Tensor in = leaf(input);
  std::vector<Tensor> out{forward(in, w)};
  out[0].backward(cotangent.to(type));
  for (Tensor* member : all_of(w)) out.push_back(member->grad());
  out.push_back(in.grad().narrow(1, 0, 3));
  out.push_back(in.grad().narrow(1, 3, 2));
  return out;
}

}  // namespace

namespace {

/// Equal to 22 bits; a bit more or less of the layers' outputs or of their gradients gives 1e-4.
/// Weights and inputs are exact in 11 bits.
void check_against_reference(const RouterWeights& weights, const Tensor& input,
                             const Tensor& cotangent, const std::vector<Order>& orders) {
  const auto expected = pass(weights, input, cotangent, torch::kFloat64, router::rounded_logits);
  for (const Order order : orders) {
    const ForcedOrder forced(order);
    const auto found =
        pass(weights, input, cotangent, torch::kFloat32, router::emulated_cuda::router_logits);
    for (size_t i = 0; i < expected.size(); ++i) {
      INFO("tensor " << i << ", order " << static_cast<int>(order));
      const double scale = expected[i].abs().max().item<double>() + 1e-30;
      CHECK((found[i] - expected[i]).abs().max().item<double>() < 2.5e-7 * scale);
    }
  }
}

}  // namespace

TEST_CASE("emulated cuda: the router's logits and gradients are those of rounded convolutions",
          "[emulated]") {
  torch::manual_seed(4);
  // With borders of 2 pixels, 29 and 5 leave a last tile of one column and one row.
  for (const auto& size : std::vector<std::vector<int64_t>>{
           {1, 1, 1}, {2, 3, 5}, {1, 5, 29}, {1, 2, 66}, {1, 18, 3}}) {
    INFO(size[0] << "x" << size[1] << "x" << size[2]);
    check_against_reference(
        whole_weights(), router::whole(0, 3, {size[0], 5, size[1], size[2]}),
        router::whole(-3, 3, {size[0], 1, size[1], size[2]}),
        size[0] > 1 ? std::vector<Order>{Order::kAscending, Order::kDescending, Order::kShuffled}
                    : std::vector<Order>{Order::kShuffled});
  }
}

TEST_CASE("emulated cuda: the router's gradients are as exact where they are far from one",
          "[emulated]") {
  torch::manual_seed(5);
  RouterWeights weights = whole_weights();
  for (Tensor* bias : {&weights.image1_bias, &weights.image2_bias, &weights.head3_bias})
    bias->zero_();
  // Half precision cannot represent either magnitude.
  for (const double scale : {0x1p23, 0x1p-30}) {
    check_against_reference(weights, scale * router::whole(0, 3, {1, 5, 3, 4}),
                            0x1p-40 * router::whole(-3, 3, {1, 1, 3, 4}), {Order::kAscending});
  }
}

TEST_CASE("emulated cuda: the router's logits are near exact ones", "[emulated]") {
  torch::manual_seed(6);
  RouterWeights weights = whole_weights();
  for (Tensor* member : all_of(weights)) *member = 0.2 * torch::randn_like(*member);
  const Tensor input = 2 * torch::rand({1, 5, 9, 40}), cotangent = torch::ones({1, 1, 9, 40});
  const Tensor exact =
      pass(weights, input, cotangent, torch::kFloat64, router::cpu::router_logits)[0];
  const Tensor found =
      pass(weights, input, cotangent, torch::kFloat32, router::emulated_cuda::router_logits)[0];
  CHECK((found - exact).abs().max().item<double>() < 1e-3 * exact.abs().max().item<double>());
}
