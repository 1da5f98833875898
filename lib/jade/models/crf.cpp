// SPDX-License-Identifier: Apache-2.0
#include "jade/models/crf.h"

#include <torch/csrc/autograd/custom_function.h>

#include "jade/core/check.h"
#include "jade/models/crf_fit.h"
#include "jade/models/crf_lookup.h"

namespace jade::models {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

class LookupFunction : public torch::autograd::Function<LookupFunction> {
 public:
  static torch::Tensor forward(AutogradContext* context, const torch::Tensor& image,
                               const torch::Tensor& table, bool mean) {
    const CrfLookup args{image.contiguous(), table.contiguous(), mean};
    context->save_for_backward({args.image, args.table});
    context->saved_data["mean"] = mean;
    return image.is_cuda() ? cuda::crf_lookup(args) : cpu::crf_lookup(args);
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const variable_list saved = context->get_saved_variables();
    const CrfLookup args{saved[0], saved[1], context->saved_data["mean"].toBool()};
    const torch::Tensor gradient = gradients[0].contiguous();
    const bool image = context->needs_input_grad(0), table = context->needs_input_grad(1);
    const CrfGradient result = gradient.is_cuda()
                                   ? cuda::crf_lookup_backward(args, gradient, image, table)
                                   : cpu::crf_lookup_backward(args, gradient, image, table);
    return {result.image, result.table, torch::Tensor()};
  }
};

torch::Tensor lookup(const torch::Tensor& image, const torch::Tensor& table, bool mean) {
  check_shape(table, "response table", {kCrfKnots});
  check_dtype(table, "response table", image.scalar_type());
  check_same_device(image, "image", table, "response table");
  return LookupFunction::apply(image, table, mean);
}

}  // namespace

CrfImpl::CrfImpl() {
  layer1 = register_module("layer1", torch::nn::Linear(1, 16));
  layer2 = register_module("layer2", torch::nn::Linear(16, 16));
  layer3 = register_module("layer3", torch::nn::Linear(16, 16));
  layer4 = register_module("layer4", torch::nn::Linear(16, 1));
  static const CrfWeights fitted = fit_identity_response();
  const torch::NoGradGuard no_grad;
  torch::nn::Linear* const layers[] = {&layer1, &layer2, &layer3, &layer4};
  for (size_t i = 0; i < 4; ++i) {
    (*layers[i])->weight.copy_(fitted.weight[i]);
    (*layers[i])->bias.copy_(fitted.bias[i]);
  }
}

torch::Tensor CrfImpl::mlp(const torch::Tensor& values) {
  torch::Tensor hidden = layer1(values.reshape({-1, 1})).relu();
  hidden = layer2(hidden).relu();
  hidden = layer3(hidden).relu();
  return layer4(hidden).view(values.sizes());
}

torch::Tensor CrfImpl::exact(const torch::Tensor& image) {
  return (0.1 * mlp(image) + image).sigmoid();
}

torch::Tensor CrfImpl::table() {
  return exact(
      torch::linspace(0, kCrfRange, kCrfKnots, layer1->weight.options().requires_grad(false)));
}

torch::Tensor CrfImpl::apply(const torch::Tensor& image, const torch::Tensor& table) {
  return lookup(image, table, false);
}

torch::Tensor CrfImpl::mean(const torch::Tensor& images, const torch::Tensor& table) {
  return lookup(images, table, true);
}

}  // namespace jade::models
