// SPDX-License-Identifier: Apache-2.0
#include "jade/losses/route.h"

#include <torch/csrc/autograd/custom_function.h>

#include "jade/core/check.h"
#include "jade/kernel/on_cuda.h"
#include "jade/losses/route_kernels.h"

namespace jade::losses {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

class RouteLossFunction : public torch::autograd::Function<RouteLossFunction> {
 public:
  /// @return RouteValue's rows; only the total has a graph
  static variable_list forward(AutogradContext* context, const torch::Tensor& alpha,
                               const RouteTensors& others) {
    context->set_materialize_grads(false);
    RouteTensors images = others;
    images.alpha = alpha;
    torch::Tensor values = torch::empty({kRouteValues}, alpha.options().requires_grad(false));
    if (alpha.is_cuda()) {
      kernel::on_cuda("the loss of the routing step", [&] { cuda::route_loss(images, values); });
    } else {
      cpu::route_loss(images, values);
    }
    context->save_for_backward(
        {alpha, images.edi, images.efnet, images.render, images.kernel, images.blurry});
    context->saved_data["reblur_weight"] = images.reblur_weight;
    variable_list out = values.unbind(0);
    context->mark_non_differentiable({out[kRouteRender], out[kRouteReblur]});
    return out;
  }

  static variable_list backward(AutogradContext* context, const variable_list& gradients) {
    const variable_list saved = context->get_saved_variables();
    const RouteTensors images{saved[0],
                              saved[1],
                              saved[2],
                              saved[3],
                              saved[4],
                              saved[5],
                              context->saved_data["reblur_weight"].toDouble()};
    torch::Tensor of_alpha = torch::empty_like(images.alpha);
    const torch::Tensor of_total = gradients[kRouteTotal].contiguous();
    if (of_alpha.is_cuda()) {
      kernel::on_cuda("the loss of the routing step",
                      [&] { cuda::route_gradient(images, of_total, of_alpha); });
    } else {
      cpu::route_gradient(images, of_total, of_alpha);
    }
    return {of_alpha, torch::Tensor()};
  }
};

/// @param like  α, whose size, type and device the image must match
torch::Tensor checked(const torch::Tensor& image, const char* what, const torch::Tensor& like,
                      int64_t channels) {
  check_shape(image, what, {channels, like.size(1), like.size(2)});
  check_dtype(image, what, like.scalar_type());
  check_same_device(image, what, like, "α");
  return image.contiguous();
}

}  // namespace

RouteLoss route_loss(const torch::Tensor& alpha, const restore::Restorations& restorations,
                     const Fixed& mid_render, const torch::Tensor& reblur_kernel,
                     const torch::Tensor& blurry, const RouteOptions& options) {
  check_shape(alpha, "α", {1, -1, -1});
  if (alpha.is_cuda()) check_dtype(alpha, "α on a GPU", torch::kFloat32);
  RouteTensors images;
  images.reblur_weight = options.reblur_weight;
  images.edi = checked(restorations.edi, "I_edi", alpha, 3);
  images.efnet = checked(restorations.efnet, "F(B, V)", alpha, 3);
  if (options.render_consistency) images.render = checked(*mid_render, "middle render", alpha, 3);
  if (options.reblur_consistency) {
    images.kernel = checked(reblur_kernel, "reblur kernel", alpha, 1);
    images.blurry = checked(blurry, "blurry frame", alpha, 3);
  }
  RouteLoss loss;
  if (!options.render_consistency && !options.reblur_consistency) return loss;
  const variable_list values = RouteLossFunction::apply(alpha.contiguous(), images);
  loss.total = values[kRouteTotal];
  if (options.render_consistency) loss.render = values[kRouteRender];
  if (options.reblur_consistency) loss.reblur = values[kRouteReblur];
  return loss;
}

}  // namespace jade::losses
