// SPDX-License-Identifier: Apache-2.0
// Eq. (6) at one pixel and its gradient by α, Eq. (5), shared by CPU and CUDA. Private to this
// folder.
#pragma once

#include <cstdint>

#include "jade/kernel/host_device.h"
#include "jade/restore/fusion_math.h"

namespace jade::losses {

/// The images of route_loss() as plain pointers. A term whose image is null is off.
template <class T>
struct RouteImages {
  const T* alpha;        ///< [H,W]
  const T *edi, *efnet;  ///< [3,H,W]
  const T* render;       ///< [3,H,W]
  const T* kernel;       ///< [H,W], K(V)
  const T* blurry;       ///< [3,H,W]
  int64_t plane;         ///< H · W
};

/// Per pixel, over the channels: sums of absolute residuals, or the weighted gradient of either
/// term's mean.
template <class T>
struct RouteParts {
  T render, reblur;
};

/// The derivative of |x|, 0 at 0 as in torch.
template <class T>
JADE_HD T slope_of_abs(T x) {
  return kernel::select(x > T(0), T(1), kernel::select(x < T(0), T(-1), T(0)));
}

template <class T>
JADE_HD RouteParts<T> route_residuals(const RouteImages<T>& in, int64_t pixel) {
  RouteParts<T> sums{0, 0};
  for (int64_t i = pixel; i < 3 * in.plane; i += in.plane) {
    const T pseudo = restore::fused(in.alpha[pixel], in.edi[i], in.efnet[i]);
    if (in.render != nullptr) sums.render += kernel::abs(pseudo - in.render[i]);
    if (in.blurry != nullptr) sums.reblur += kernel::abs(pseudo * in.kernel[pixel] - in.blurry[i]);
  }
  return sums;
}

template <class T>
JADE_HD T route_gradient(const RouteImages<T>& in, const RouteParts<T>& of, int64_t pixel) {
  T of_alpha = 0;
  for (int64_t i = pixel; i < 3 * in.plane; i += in.plane) {
    const T pseudo = restore::fused(in.alpha[pixel], in.edi[i], in.efnet[i]);
    T of_pseudo = 0;
    if (in.render != nullptr) of_pseudo += of.render * slope_of_abs(pseudo - in.render[i]);
    if (in.blurry != nullptr) {
      const T k = in.kernel[pixel];
      of_pseudo += of.reblur * slope_of_abs(pseudo * k - in.blurry[i]) * k;
    }
    of_alpha += of_pseudo * restore::fused_by_alpha(in.edi[i], in.efnet[i]);
  }
  return of_alpha;
}

}  // namespace jade::losses
