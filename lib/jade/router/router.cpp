// SPDX-License-Identifier: Apache-2.0
#include "jade/router/router.h"

#include <cmath>
#include <torch/nn/init.h>

#include "jade/core/check.h"
#include "jade/kernel/on_cuda.h"
#include "jade/router/logits.h"

namespace jade::router {
namespace {

torch::nn::Conv2d convolution(int64_t in, int64_t out, int64_t kernel, bool bias) {
  return torch::nn::Conv2d(torch::nn::Conv2dOptions(in, out, kernel)
                               .padding(kernel / 2)
                               .padding_mode(torch::kReplicate)
                               .bias(bias));
}

/// Samples weights and biases uniformly within ±1/sqrt(fan-in), from this library's generator.
void draw_weights(torch::nn::Conv2d& layer, at::Generator& generator) {
  const torch::NoGradGuard no_grad;
  const double fan_in = static_cast<double>(layer->weight.numel() / layer->weight.size(0));
  const double bound = 1 / std::sqrt(fan_in);
  layer->weight.uniform_(-bound, bound, generator);
  if (layer->bias.defined()) layer->bias.uniform_(-bound, bound, generator);
}

RouterWeights weights_of(const RouterImpl& router) {
  RouterWeights weights;
  weights.event1 = router.event1->weight;
  weights.event2 = router.event2->weight;
  weights.image1 = router.image1->weight;
  weights.image1_bias = router.image1->bias;
  weights.image2 = router.image2->weight;
  weights.image2_bias = router.image2->bias;
  weights.head1 = router.head1->weight;
  weights.head2 = router.head2->weight;
  weights.head3 = router.head3->weight;
  weights.head3_bias = router.head3->bias;
  return weights;
}

}  // namespace

RouterImpl::RouterImpl(at::Generator generator) {
  event1 = register_module("event1", convolution(2, 16, 5, false));
  event2 = register_module("event2", convolution(16, 6, 5, false));
  image1 = register_module("image1", convolution(3, 10, 5, true));
  image2 = register_module("image2", convolution(10, 8, 5, true));
  head1 = register_module("head1", convolution(17, 9, 3, false));
  head2 = register_module("head2", convolution(9, 24, 3, false));
  head3 = register_module("head3", convolution(24, 1, 1, true));
  for (auto* layer : {&event1, &event2, &image1, &image2, &head1, &head2, &head3}) {
    draw_weights(*layer, generator);
  }
}

torch::Tensor RouterImpl::logits(const torch::Tensor& input) {
  check_shape(input, "router: input", {-1, 5, -1, -1});
  if (input.is_cpu()) return cpu::router_logits(input, weights_of(*this));
  if (!input.is_cuda() || input.scalar_type() != torch::kFloat32) return logits_by_layers(input);
  return kernel::on_cuda("the router",
                         [&] { return cuda::router_logits(input, weights_of(*this)); });
}

torch::Tensor RouterImpl::logits_by_layers(const torch::Tensor& input) {
  const torch::Tensor blurry = input.narrow(1, 0, 3), psi = input.narrow(1, 3, 2);
  const torch::Tensor events = event2(event1(psi).relu_()).relu_();
  const torch::Tensor image = image2(image1(blurry).relu_()).relu_();
  const torch::Tensor hidden = head1(torch::cat({blurry, events, image}, 1)).relu_();
  return head3(head2(hidden).relu_());
}

torch::Tensor RouterImpl::forward(const torch::Tensor& input) { return logits(input).sigmoid(); }

}  // namespace jade::router
