// SPDX-License-Identifier: Apache-2.0
#include "jade/response/camera_response.h"

#include <algorithm>
#include <torch/csrc/autograd/custom_function.h>

#include "jade/core/check.h"
#include "jade/kernel/on_cuda.h"
#include "jade/response/identity_response.h"
#include "jade/response/lookup.h"
#include "jade/response/table.h"

namespace jade::response {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

/// Weights of the images of a call, in their order; undefined if an image has none.
struct LookupWeights {
  std::vector<torch::Tensor> all;
};

class LookupFunction : public torch::autograd::Function<LookupFunction> {
 public:
  /// @param tensors  the images, then the table
  static variable_list forward(AutogradContext* context, at::TensorList tensors,
                               const LookupWeights& weights) {
    context->set_materialize_grads(false);
    variable_list saved;
    for (const torch::Tensor& each : tensors) saved.push_back(each.contiguous());
    saved.insert(saved.end(), weights.all.begin(), weights.all.end());
    context->save_for_backward(saved);
    const Lookups args = lookups_of(saved);
    if (!args.table.is_cuda()) return cpu::lookup(args);
    return kernel::on_cuda("the camera response", [&] { return cuda::lookup(args); });
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const Lookups args = lookups_of(context->get_saved_variables());
    const size_t count = args.images.size();
    variable_list result(count + 2);  // one for the weights
    LookupWanted wanted;
    for (size_t i = 0; i < count; ++i) wanted.images.push_back(context->needs_input_grad(i));
    wanted.table = context->needs_input_grad(count);
    bool any = false;
    for (torch::Tensor& gradient : gradients) {
      if (!gradient.defined()) continue;
      gradient = gradient.contiguous();
      any = true;
    }
    if (!any) return result;
    LookupGradients found = !args.table.is_cuda()
                                ? cpu::lookup_backward(args, gradients, wanted)
                                : kernel::on_cuda("the camera response", [&] {
                                    return cuda::lookup_backward(args, gradients, wanted);
                                  });
    std::move(found.images.begin(), found.images.end(), result.begin());
    result[count] = found.table;
    return result;
  }

 private:
  /// @param saved  the images, the table, the images' weights
  static Lookups lookups_of(const variable_list& saved) {
    const size_t count = saved.size() / 2;
    Lookups args;
    args.table = saved[count];
    for (size_t i = 0; i < count; ++i) args.images.push_back({saved[i], saved[count + 1 + i]});
    return args;
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

}  // namespace

CameraResponseImpl::CameraResponseImpl() {
  layer1 = register_module("layer1", torch::nn::Linear(1, 16));
  layer2 = register_module("layer2", torch::nn::Linear(16, 16));
  layer3 = register_module("layer3", torch::nn::Linear(16, 16));
  layer4 = register_module("layer4", torch::nn::Linear(16, 1));
  const Weights& start = identity_response();
  const torch::NoGradGuard no_grad;
  torch::nn::Linear* const layers[] = {&layer1, &layer2, &layer3, &layer4};
  for (size_t i = 0; i < 4; ++i) {
    (*layers[i])->weight.copy_(start.weight[i]);
    (*layers[i])->bias.copy_(start.bias[i]);
  }
}

torch::Tensor CameraResponseImpl::exact(const torch::Tensor& image) {
  torch::Tensor hidden = layer1(image.reshape({-1, 1})).relu();
  hidden = layer2(hidden).relu();
  hidden = layer3(hidden).relu();
  return (0.1 * layer4(hidden).view(image.sizes()) + image).sigmoid();
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

std::vector<torch::Tensor> CameraResponseImpl::apply_all(const std::vector<ResponseInput>& inputs,
                                                         const torch::Tensor& table) {
  check_shape(table, "response table", {kKnots});
  JADE_CHECK(!inputs.empty() && (!table.is_cuda() || inputs.size() <= kMostLookups),
             "expected 1 to ", kMostLookups, " images for the response, found ", inputs.size());
  variable_list tensors;
  LookupWeights weights;
  for (const ResponseInput& input : inputs) {
    const torch::Tensor& image = input.image;
    check_dtype(table, "response table", image.scalar_type());
    check_same_device(image, "image", table, "response table");
    tensors.push_back(image);
    weights.all.emplace_back();
    if (!input.weights.defined()) continue;
    JADE_CHECK(image.dim() > 1, "expected images [K,...], found ", shape_string(image));
    check_shape(input.weights, "weights of the images", {image.size(0)});
    const bool few = input.weights.is_cpu() && input.weights.numel() <= kFewWeights;
    weights.all.back() =
        (few ? input.weights.to(image.scalar_type()) : input.weights.to(image.options()))
            .contiguous();
  }
  tensors.push_back(table);
  return LookupFunction::apply(at::TensorList(tensors), weights);
}

}  // namespace jade::response
