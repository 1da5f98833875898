// SPDX-License-Identifier: Apache-2.0
#include <c10/cuda/CUDAGuard.h>
#include <c10/cuda/CUDAStream.h>
#include <torch/csrc/autograd/custom_function.h>

#include "jade/core/check.h"
#include "jade/kernel/launch.h"
#include "jade/router/conv_layer.h"
#include "jade/router/logits.h"

namespace jade::router::cuda {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

ConvLayer layer_of(const torch::Tensor& in, const torch::Tensor& weights, const torch::Tensor& bias,
                   const torch::Tensor& out, bool relu) {
  ConvLayer layer;
  layer.shape = {static_cast<int>(in.size(1)), static_cast<int>(weights.size(0)),
                 static_cast<int>(weights.size(2))};
  layer.batch = static_cast<int>(in.size(0));
  layer.height = static_cast<int>(in.size(2));
  layer.width = static_cast<int>(in.size(3));
  layer.relu = relu;
  layer.in = in.const_data_ptr<float>();
  layer.weights = weights.const_data_ptr<float>();
  layer.bias = bias.numel() > 0 ? bias.const_data_ptr<float>() : nullptr;
  layer.out = const_cast<float*>(out.const_data_ptr<float>());
  return layer;
}

class ConvFunction : public torch::autograd::Function<ConvFunction> {
 public:
  static torch::Tensor forward(AutogradContext* context, const torch::Tensor& in,
                               const torch::Tensor& weights, const torch::Tensor& bias, bool relu) {
    const c10::cuda::CUDAGuard guard(in.device());
    const torch::Tensor image = in.contiguous(), taps = weights.contiguous();
    const torch::Tensor out =
        torch::empty({in.size(0), weights.size(0), in.size(2), in.size(3)}, in.options());
    conv_forward(layer_of(image, taps, bias, out, relu), c10::cuda::getCurrentCUDAStream());
    kernel::check_launch("a layer of the router");
    context->save_for_backward({image, taps, out});
    context->saved_data["relu"] = relu;
    context->saved_data["bias"] = bias.numel() > 0;
    return out;
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const variable_list saved = context->get_saved_variables();
    const torch::Tensor &in = saved[0], &weights = saved[1], &out = saved[2];
    const c10::cuda::CUDAGuard guard(in.device());
    const torch::Tensor of_out = gradients[0].contiguous();
    const int64_t border = weights.size(2) - 1, outputs = weights.size(0);
    ConvGradient args;
    args.layer =
        layer_of(in, weights, weights.new_empty({0}), out, context->saved_data["relu"].toBool());
    args.of_out = of_out.const_data_ptr<float>();
    const torch::Tensor sums = torch::empty({weights.numel() + outputs}, in.options());
    const torch::Tensor partial =
        torch::empty({partial_rows(args.layer), sums.numel()}, in.options());
    args.partial = partial.mutable_data_ptr<float>();
    args.of_weights = sums.mutable_data_ptr<float>();
    torch::Tensor of_in, padded;
    if (context->needs_input_grad(0)) {
      of_in = torch::empty_like(in);
      padded = torch::empty({in.size(0), in.size(1), in.size(2) + border, in.size(3) + border},
                            in.options());
      args.of_in = of_in.mutable_data_ptr<float>();
      args.padded = padded.mutable_data_ptr<float>();
    }
    conv_backward(args, c10::cuda::getCurrentCUDAStream());
    kernel::check_launch("a layer of the router, backward");
    const torch::Tensor of_weights = sums.narrow(0, 0, weights.numel()).view(weights.sizes());
    torch::Tensor of_bias;
    if (context->saved_data["bias"].toBool()) {
      of_bias = sums.narrow(0, weights.numel(), outputs);
    }
    return {of_in, of_weights, of_bias, torch::Tensor()};
  }
};

/// relu(bias + w * replicate_pad(in)) for the router's seven layer shapes.
/// @param in       [N,C,H,W]
/// @param weights  [O,C,K,K]
/// @param bias     [O], or undefined.
torch::Tensor conv_layer(const torch::Tensor& in, const torch::Tensor& weights,
                         const torch::Tensor& bias = {}, bool relu = true) {
  check_dtype(in, "router layer input", torch::kFloat32);
  check_shape(weights, "router layer weights", {-1, in.size(1), -1, -1});
  const ConvShape shape{static_cast<int>(in.size(1)), static_cast<int>(weights.size(0)),
                        static_cast<int>(weights.size(2))};
  JADE_CHECK(is_compiled(shape) && weights.size(2) == weights.size(3),
             "no compiled layer for weights ", shape_string(weights));
  // An autograd function takes no undefined tensor.
  return ConvFunction::apply(in, weights, bias.defined() ? bias.contiguous() : in.new_empty({0}),
                             relu);
}

}  // namespace

torch::Tensor router_logits(const torch::Tensor& blurry, const torch::Tensor& psi,
                            const RouterWeights& w) {
  const torch::Tensor events = conv_layer(conv_layer(psi, w.event1), w.event2);
  const torch::Tensor image =
      conv_layer(conv_layer(blurry, w.image1, w.image1_bias), w.image2, w.image2_bias);
  const torch::Tensor hidden = conv_layer(torch::cat({blurry, events, image}, 1), w.head1);
  return conv_layer(conv_layer(hidden, w.head2), w.head3, w.head3_bias, false);
}

}  // namespace jade::router::cuda
