// SPDX-License-Identifier: Apache-2.0
// SSIM and D without autograd; ssim_math.h has the arithmetic. Private to this folder.
#pragma once

#include <ATen/core/Tensor.h>
#include <cstdint>
#include <vector>

namespace jade::imaging {

/// Maximum number of pairs in one batch on a GPU, where they are a kernel argument.
constexpr int64_t kMostPairs = 16;

/// value = offset + ssim · mean SSIM + l1 · mean |a − b|.
struct SsimWeights {
  double offset = 0, ssim = 0, l1 = 0;
};

/// Two images: all tensors contiguous, of one shape, floating type and device.
struct SsimPair {
  at::Tensor a, b;
  at::Tensor mean_b, square_b;          ///< window means of b and b², or both undefined
  bool grad_a = false, grad_b = false;  ///< which gradients to compute
};

/// A term is the weighted sum of the values of `pairs` pairs.
struct SsimTerm {
  int64_t pairs = 1;
  double weight = 1;
  at::Tensor scale;  ///< [] on the device, an additional weight; undefined: 1
};

/// Pairs of one height and width, in the order of the terms.
struct SsimBatch {
  std::vector<SsimPair> pairs;
  std::vector<SsimTerm> terms;
  SsimWeights weights;

  bool any_gradient() const {
    for (const SsimPair& pair : pairs) {
      if (pair.grad_a || pair.grad_b) return true;
    }
    return false;
  }
};

struct SsimValues {
  at::Tensor total;  ///< []
  at::Tensor terms;  ///< [T], weights applied
  /// Values that the gradients need in addition to the batch. CPU: gradients of each pair's value,
  /// two per pair; CUDA: one buffer of derivative maps. Undefined if no gradient is required.
  std::vector<at::Tensor> kept;
};

/// Gradients of the outputs; undefined: none.
struct SsimUpstream {
  at::Tensor total, terms;
};

/// [..., H, W] as a number of planes.
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
SsimValues similarity(const SsimBatch& batch);
/// Gradients of a and b of every pair in turn; undefined if not required.
std::vector<at::Tensor> similarity_gradients(const SsimBatch& batch,
                                             const std::vector<at::Tensor>& kept,
                                             const SsimUpstream& upstream);
/// Window means of an image and of its square.
void window_means(const at::Tensor& image, at::Tensor& mean, at::Tensor& square);
}  // namespace cpu

namespace cuda {  // float
/// Runs on the current stream of the images' device without waiting. At most kMostPairs pairs.
/// @throws DeviceError.
SsimValues similarity(const SsimBatch& batch);
std::vector<at::Tensor> similarity_gradients(const SsimBatch& batch,
                                             const std::vector<at::Tensor>& kept,
                                             const SsimUpstream& upstream);
}  // namespace cuda

}  // namespace jade::imaging
