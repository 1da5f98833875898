// SPDX-License-Identifier: Apache-2.0
#include "jade/router/router.h"

#include <cmath>
#include <torch/nn/init.h>

#include "jade/core/check.h"
#include "jade/router/cpu/router_cpu.h"
#include "jade/router/cuda/router_cuda.h"

namespace jade::router {
namespace {

torch::nn::Conv2d convolution(int64_t in, int64_t out, int64_t kernel, bool bias) {
  return torch::nn::Conv2d(torch::nn::Conv2dOptions(in, out, kernel)
                               .padding(kernel / 2)
                               .padding_mode(torch::kReplicate)
                               .bias(bias));
}

/// Uniform within ±1/sqrt(fan-in), weights and biases, from our own generator.
void draw_weights(torch::nn::Conv2d& layer, at::Generator& generator) {
  const torch::NoGradGuard no_grad;
  const double fan_in = static_cast<double>(layer->weight.numel() / layer->weight.size(0));
  const double bound = 1 / std::sqrt(fan_in);
  layer->weight.uniform_(-bound, bound, generator);
  if (layer->bias.defined()) layer->bias.uniform_(-bound, bound, generator);
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

torch::Tensor RouterImpl::logits(const torch::Tensor& blurry, const torch::Tensor& psi) {
  check_shape(blurry, "router: blurry frame", {-1, 3, -1, -1});
  check_shape(psi, "router: event projection", {blurry.size(0), 2, blurry.size(2), blurry.size(3)});
  if (blurry.is_cpu()) return logits_cpu(blurry, psi);
  const bool compiled = blurry.is_cuda() && blurry.scalar_type() == torch::kFloat32;
  return compiled ? logits_cuda(blurry, psi) : logits_by_layers(blurry, psi);
}

torch::Tensor RouterImpl::logits_by_layers(const torch::Tensor& blurry, const torch::Tensor& psi) {
  const torch::Tensor events = event2(event1(psi).relu_()).relu_();
  const torch::Tensor image = image2(image1(blurry).relu_()).relu_();
  const torch::Tensor hidden = head1(torch::cat({blurry, events, image}, 1)).relu_();
  return head3(head2(hidden).relu_());
}

torch::Tensor RouterImpl::logits_cuda(const torch::Tensor& blurry, const torch::Tensor& psi) {
  const auto layer = [](const torch::nn::Conv2d& conv, const torch::Tensor& in, bool relu = true) {
    return cuda::conv_layer(in, conv->weight, conv->bias, relu);
  };
  const torch::Tensor events = layer(event2, layer(event1, psi));
  const torch::Tensor image = layer(image2, layer(image1, blurry));
  const torch::Tensor hidden = layer(head1, torch::cat({blurry, events, image}, 1));
  return layer(head3, layer(head2, hidden), false);
}

torch::Tensor RouterImpl::logits_cpu(const torch::Tensor& blurry, const torch::Tensor& psi) {
  cpu::RouterWeights weights;
  weights.event1 = event1->weight;
  weights.event2 = event2->weight;
  weights.image1 = image1->weight;
  weights.image1_bias = image1->bias;
  weights.image2 = image2->weight;
  weights.image2_bias = image2->bias;
  weights.head1 = head1->weight;
  weights.head2 = head2->weight;
  weights.head3 = head3->weight;
  weights.head3_bias = head3->bias;
  return cpu::router_logits(blurry, psi, weights);
}

torch::Tensor RouterImpl::forward(const torch::Tensor& blurry, const torch::Tensor& psi) {
  return logits(blurry, psi).sigmoid();
}

}  // namespace jade::router
