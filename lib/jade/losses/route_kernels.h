// SPDX-License-Identifier: Apache-2.0
// route_loss() without autograd. Private to this folder.
#pragma once

#include <ATen/core/Tensor.h>

#include "jade/losses/route_math.h"

namespace jade::losses {

/// All of one type and contiguous. A term that is off has undefined images.
struct RouteTensors {
  at::Tensor alpha, edi, efnet, render, kernel, blurry;
  double reblur_weight = 1;
};

/// Rows of `values`, [3] of the images' type.
enum RouteValue { kRouteTotal, kRouteRender, kRouteReblur, kRouteValues };

namespace cpu {  // float or double; any number of threads gives the same bits
void route_loss(const RouteTensors& images, at::Tensor& values);
/// @param of_total  [] of the images' type
/// @param of_alpha  [1,H,W], written
void route_gradient(const RouteTensors& images, const at::Tensor& of_total, at::Tensor& of_alpha);
}  // namespace cpu

namespace cuda {  // float; runs on the current stream without waiting, deterministic
void route_loss(const RouteTensors& images, at::Tensor& values);
void route_gradient(const RouteTensors& images, const at::Tensor& of_total, at::Tensor& of_alpha);
}  // namespace cuda

/// @tparam T  of the images
template <class T>
RouteImages<T> pointers_of(const RouteTensors& images) {
  const auto pointer = [](const at::Tensor& image) {
    return image.defined() ? image.const_data_ptr<T>() : nullptr;
  };
  return {pointer(images.alpha),  pointer(images.edi),    pointer(images.efnet),
          pointer(images.render), pointer(images.kernel), pointer(images.blurry),
          images.alpha.numel()};
}

}  // namespace jade::losses
