// SPDX-License-Identifier: Apache-2.0
#include "jade/response/camera_response.h"

#include <algorithm>
#include <optional>
#include <torch/csrc/autograd/custom_function.h>

#include "jade/core/check.h"
#include "jade/kernel/on_cuda.h"
#include "jade/response/identity_fit.h"
#include "jade/response/lookup.h"
#include "jade/response/table.h"

namespace jade::response {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

class LookupFunction : public torch::autograd::Function<LookupFunction> {
 public:
  static torch::Tensor forward(AutogradContext* context, const torch::Tensor& image,
                               const torch::Tensor& table,
                               const std::optional<torch::Tensor>& weights) {
    const Lookup args{image.contiguous(), table.contiguous(), weights.value_or(torch::Tensor())};
    context->save_for_backward({args.image, args.table, args.weights});
    if (!image.is_cuda()) return cpu::lookup(args);
    return kernel::on_cuda("the camera response", [&] { return cuda::lookup(args); });
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const variable_list saved = context->get_saved_variables();
    const Lookup args{saved[0], saved[1], saved[2]};
    const torch::Tensor gradient = gradients[0].contiguous();
    const bool image = context->needs_input_grad(0), table = context->needs_input_grad(1);
    const LookupGradient result =
        !gradient.is_cuda() ? cpu::lookup_backward(args, gradient, image, table)
                            : kernel::on_cuda("the camera response", [&] {
                                return cuda::lookup_backward(args, gradient, image, table);
                              });
    return {result.image, result.table, torch::Tensor()};
  }
};

class TableFunction : public torch::autograd::Function<TableFunction> {
 public:
  /// @param weights  NetworkWeights
  static torch::Tensor forward(AutogradContext* context, at::TensorList weights) {
    NetworkWeights network;
    std::copy(weights.begin(), weights.end(), network.begin());
    const torch::Tensor table = kernel::on_cuda("the table of the camera response",
                                                [&] { return cuda::response_table(network); });
    variable_list saved = weights.vec();
    saved.push_back(table);
    context->save_for_backward(saved);
    return table;
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const variable_list saved = context->get_saved_variables();
    NetworkWeights network;
    std::copy_n(saved.begin(), network.size(), network.begin());
    const torch::Tensor of_table = gradients[0].contiguous();
    const torch::Tensor all = kernel::on_cuda("the table of the camera response", [&] {
      return cuda::response_table_gradient(network, saved.back(), of_table);
    });
    variable_list result;
    for (size_t p = 0; p < network.size(); ++p) {
      const int begin = kParameterOffsets[p], end = kParameterOffsets[p + 1];
      result.push_back(all.narrow(0, begin, end - begin).view(network[p].sizes()));
    }
    return result;
  }
};

torch::Tensor lookup(const torch::Tensor& image, const torch::Tensor& table,
                     const torch::Tensor& weights) {
  check_shape(table, "response table", {kKnots});
  check_dtype(table, "response table", image.scalar_type());
  check_same_device(image, "image", table, "response table");
  return LookupFunction::apply(image, table, std::optional<torch::Tensor>(weights));
}

}  // namespace

CameraResponseImpl::CameraResponseImpl() {
  layer1 = register_module("layer1", torch::nn::Linear(1, 16));
  layer2 = register_module("layer2", torch::nn::Linear(16, 16));
  layer3 = register_module("layer3", torch::nn::Linear(16, 16));
  layer4 = register_module("layer4", torch::nn::Linear(16, 1));
  static const Weights fitted = fit_identity_response();
  const torch::NoGradGuard no_grad;
  torch::nn::Linear* const layers[] = {&layer1, &layer2, &layer3, &layer4};
  for (size_t i = 0; i < 4; ++i) {
    (*layers[i])->weight.copy_(fitted.weight[i]);
    (*layers[i])->bias.copy_(fitted.bias[i]);
  }
}

torch::Tensor CameraResponseImpl::mlp(const torch::Tensor& values) {
  torch::Tensor hidden = layer1(values.reshape({-1, 1})).relu();
  hidden = layer2(hidden).relu();
  hidden = layer3(hidden).relu();
  return layer4(hidden).view(values.sizes());
}

torch::Tensor CameraResponseImpl::exact(const torch::Tensor& image) {
  return (0.1 * mlp(image) + image).sigmoid();
}

torch::Tensor CameraResponseImpl::table() {
  const variable_list weights{layer1->weight, layer1->bias, layer2->weight, layer2->bias,
                              layer3->weight, layer3->bias, layer4->weight, layer4->bias};
  const torch::Tensor& first = weights[0];
  if (first.is_cuda() && first.scalar_type() == torch::kFloat32) {
    return TableFunction::apply(at::TensorList(weights));
  }
  return exact(
      torch::linspace(0, kResponseRange, kKnots, layer1->weight.options().requires_grad(false)));
}

torch::Tensor CameraResponseImpl::apply(const torch::Tensor& image, const torch::Tensor& table) {
  return lookup(image, table, {});
}

torch::Tensor CameraResponseImpl::mean(const torch::Tensor& images, const torch::Tensor& table,
                                       const torch::Tensor& weights) {
  JADE_CHECK(images.dim() > 1, "expected images [K,...], found ", shape_string(images));
  if (!weights.defined()) {
    const auto count = static_cast<double>(images.size(0));
    return lookup(images, table,
                  torch::full({images.size(0)}, 1 / count, table.options().requires_grad(false)));
  }
  check_shape(weights, "weights of the images", {images.size(0)});
  return lookup(images, table, weights.to(images.options()).contiguous());
}

}  // namespace jade::response
