// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <c10/cuda/CUDAGuard.h>
#include <c10/cuda/CUDAStream.h>
#include <torch/csrc/autograd/custom_function.h>

#include "jade/core/check.h"
#include "jade/kernel/launch.h"
#include "jade/kernel/side_stream.h"
#include "jade/router/conv_layer.h"
#include "jade/router/logits.h"

namespace jade::router::cuda {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

/// X_in, then weights, then biases: the order of all autograd inputs.
enum Input { kInput, kWeights, kBiases = kWeights + kLayers, kInputs = kBiases + 3 };
constexpr Layer kBiased[] = {kImage1, kImage2, kHead3};

/// Outputs of layers.
struct Activations {
  torch::Tensor event1, image1, features, head1, head2;
};

torch::Tensor planes(const torch::Tensor& like, int64_t channels) {
  return torch::empty({like.size(0), channels, like.size(2), like.size(3)}, like.options());
}

float* data(const torch::Tensor& tensor) {
  return tensor.defined() ? tensor.mutable_data_ptr<float>() : nullptr;
}

Network network_of(const variable_list& inputs, const torch::Tensor& prepared,
                   const Activations& activations) {
  Network net;
  const torch::Tensor& input = inputs[kInput];
  net.batch = static_cast<int>(input.size(0));
  net.height = static_cast<int>(input.size(2));
  net.width = static_cast<int>(input.size(3));
  net.input = input.const_data_ptr<float>();
  for (int i = 0; i < kLayers; ++i) net.weights[i] = inputs[kWeights + i].const_data_ptr<float>();
  for (int i = 0; i < 3; ++i) net.bias[kBiased[i]] = inputs[kBiases + i].const_data_ptr<float>();
  net.prepared = reinterpret_cast<uint32_t*>(prepared.mutable_data_ptr<int32_t>());
  net.event1 = data(activations.event1);
  net.image1 = data(activations.image1);
  net.features = data(activations.features);
  net.head1 = data(activations.head1);
  net.head2 = data(activations.head2);
  return net;
}

struct Answer {
  torch::Tensor logits, prepared;
  Activations activations;
};

/// @param keep  whether to store head2's output for backward()
Answer run_forward(const variable_list& inputs, bool keep) {
  const torch::Tensor& like = inputs[kInput];
  const c10::cuda::CUDAGuard guard(like.device());
  Answer answer{planes(like, 1),
                torch::empty({prepared_words()}, like.options().dtype(torch::kInt32)),
                {planes(like, 16), planes(like, 10), planes(like, 14), planes(like, 9),
                 keep ? planes(like, 24) : torch::Tensor()}};
  Network net = network_of(inputs, answer.prepared, answer.activations);
  net.logits = data(answer.logits);
  forward(net, c10::cuda::getCurrentCUDAStream());
  kernel::check_launch("the router");
  return answer;
}

class RouterFunction : public torch::autograd::Function<RouterFunction> {
 public:
  static torch::Tensor forward(AutogradContext* context, at::TensorList given,
                               bool needs_backward) {
    variable_list saved;
    for (const torch::Tensor& tensor : given) saved.push_back(tensor.contiguous());
    const Answer answer = run_forward(saved, needs_backward);
    if (!needs_backward) return answer.logits;
    const Activations& kept = answer.activations;
    for (const torch::Tensor& each :
         {answer.prepared, kept.event1, kept.image1, kept.features, kept.head1, kept.head2}) {
      saved.push_back(each);
    }
    context->save_for_backward(saved);
    return answer.logits;
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const variable_list saved = context->get_saved_variables();
    const torch::Tensor& input = saved[kInput];
    const c10::cuda::CUDAGuard guard(input.device());
    const torch::Tensor* const kept = &saved[kInputs];
    const Network net = network_of(saved, kept[0], {kept[1], kept[2], kept[3], kept[4], kept[5]});
    const torch::Tensor of_logits = gradients[0].contiguous();
    const Activations of_outputs{
        planes(input, 16), planes(input, 10), planes(input, 14), planes(input, 9), {}};
    const torch::Tensor partial =
        torch::empty({partial_rows(net), weight_count()}, input.options());
    const torch::Tensor of_weights = torch::empty({weight_count()}, input.options());
    torch::Tensor of_input;
    if (context->needs_input_grad(kInput)) of_input = torch::empty_like(input);
    NetworkGradient of;
    of.of_logits = of_logits.const_data_ptr<float>();
    of.of_event1 = data(of_outputs.event1);
    of.of_image1 = data(of_outputs.image1);
    of.of_features = data(of_outputs.features);
    of.of_head1 = data(of_outputs.head1);
    of.partial = data(partial);
    of.of_weights = data(of_weights);
    of.of_input = data(of_input);
    const cudaStream_t stream = c10::cuda::getCurrentCUDAStream();
    kernel::SideStream side(input.is_cuda() ? input.get_device() : -1);
    cuda::backward(net, of, stream, [&side](const std::function<void(cudaStream_t)>& work) {
      side.follow();
      side.run([&work] { work(c10::cuda::getCurrentCUDAStream()); });
    });
    side.join();
    sum_weights(net, of, stream);
    kernel::check_launch("the router, backward");

    variable_list out{of_input};
    for (int i = 0; i < kLayers; ++i) {
      const torch::Tensor& weights = saved[kWeights + i];
      out.push_back(of_weights.narrow(0, weights_begin(static_cast<Layer>(i)), weights.numel())
                        .view(weights.sizes()));
    }
    for (int i = 0; i < 3; ++i) {
      const int64_t begin = weights_begin(kBiased[i]) + saved[kWeights + kBiased[i]].numel();
      out.push_back(of_weights.narrow(0, begin, saved[kBiases + i].numel()));
    }
    out.emplace_back();  // gradient of needs_backward
    return out;
  }
};

void check(const torch::Tensor& tensor, const char* what, const std::vector<int64_t>& shape) {
  check_dtype(tensor, what, torch::kFloat32);
  check_shape(tensor, what, shape);
}

}  // namespace

torch::Tensor router_logits(const torch::Tensor& input, const RouterWeights& w) {
  check(input, "router input", {-1, 5, -1, -1});
  check(w.event1, "router weights", {16, 2, 5, 5});
  check(w.event2, "router weights", {6, 16, 5, 5});
  check(w.image1, "router weights", {10, 3, 5, 5});
  check(w.image2, "router weights", {8, 10, 5, 5});
  check(w.head1, "router weights", {9, 17, 3, 3});
  check(w.head2, "router weights", {24, 9, 3, 3});
  check(w.head3, "router weights", {1, 24, 1, 1});
  check(w.image1_bias, "router bias", {10});
  check(w.image2_bias, "router bias", {8});
  check(w.head3_bias, "router bias", {1});
  const variable_list inputs = {input,         w.event1,      w.event2,    w.image1,
                                w.image2,      w.head1,       w.head2,     w.head3,
                                w.image1_bias, w.image2_bias, w.head3_bias};
  const bool needs_backward =
      torch::GradMode::is_enabled() &&
      std::any_of(inputs.begin(), inputs.end(),
                  [](const torch::Tensor& tensor) { return tensor.requires_grad(); });
  return RouterFunction::apply(at::TensorList(inputs), needs_backward);
}

}  // namespace jade::router::cuda
