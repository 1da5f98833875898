// SPDX-License-Identifier: Apache-2.0
// SSIM and D apart from autograd; the arithmetic is in ssim_math.h. Not for use outside this room.
#pragma once

#include <ATen/core/Tensor.h>
#include <cstdint>

namespace jade::imaging {

/// value = offset + ssim · mean SSIM + l1 · mean |a − b|.
struct SsimWeights {
  double offset = 0, ssim = 0, l1 = 0;
};

/// All tensors contiguous, of one shape, floating type and device.
struct SsimArguments {
  at::Tensor a, b;
  at::Tensor mean_b, square_b;  ///< window means of b and b², or both undefined
  SsimWeights weights;
  at::Tensor grad_a, grad_b;  ///< filled with the value's gradients; undefined where not wanted
};

/// [..., H, W] as so many planes.
struct ImagePlanes {
  int64_t count = 0, height = 0, width = 0;
};
inline ImagePlanes planes_of(const at::Tensor& image) {
  const int64_t height = image.size(-2), width = image.size(-1);
  return {image.numel() / (height * width), height, width};
}

template <class T>
const T* read_or_null(const at::Tensor& tensor) {
  return tensor.defined() ? tensor.template const_data_ptr<T>() : nullptr;
}
template <class T>
T* write_or_null(const at::Tensor& tensor) {
  return tensor.defined() ? tensor.template mutable_data_ptr<T>() : nullptr;
}

/// The 11 taps of the window, which sum to 1.
const double* ssim_window();

namespace cpu {  // float or double
/// The value, a scalar.
at::Tensor similarity(const SsimArguments& arguments);
/// Window means of an image and of its square.
void window_means(const at::Tensor& image, at::Tensor& mean, at::Tensor& square);
}  // namespace cpu

namespace cuda {  // float
/// On the current stream of the images' device; no waiting. @throws DeviceError.
at::Tensor similarity(const SsimArguments& arguments);
}  // namespace cuda

}  // namespace jade::imaging
