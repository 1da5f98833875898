// SPDX-License-Identifier: Apache-2.0
// SSIM and D apart from autograd; the arithmetic is in ssim_math.h. Not for use outside this room.
#pragma once

#include <ATen/core/Tensor.h>
#include <cstdint>
#include <vector>

namespace jade::imaging {

/// Most pairs in one batch on a GPU, where they travel as the argument of a launch.
constexpr int64_t kMostPairs = 16;

/// value = offset + ssim · mean SSIM + l1 · mean |a − b|.
struct SsimWeights {
  double offset = 0, ssim = 0, l1 = 0;
};

/// Two images: all tensors contiguous, of one shape, floating type and device.
struct SsimPair {
  at::Tensor a, b;
  at::Tensor mean_b, square_b;          ///< window means of b and b², or both undefined
  bool grad_a = false, grad_b = false;  ///< which gradients are wanted
};

/// A term is the sum of the values of so many pairs, times a weight.
struct SsimTerm {
  int64_t pairs = 1;
  double weight = 1;
  at::Tensor scale;  ///< [] on the device, a further weight; undefined: 1
};

/// Pairs of one height and width, those of the first term first.
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
  /// Values that the gradients need beside the batch. CPU: gradients of each pair's value, two per
  /// pair; CUDA: one buffer of derivative maps. Undefined where no gradient is wanted.
  std::vector<at::Tensor> kept;
};

/// Gradients of the outputs; undefined: none.
struct SsimUpstream {
  at::Tensor total, terms;
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
SsimValues similarity(const SsimBatch& batch);
/// Gradients of a and b of every pair in turn; undefined where not wanted.
std::vector<at::Tensor> similarity_gradients(const SsimBatch& batch,
                                             const std::vector<at::Tensor>& kept,
                                             const SsimUpstream& upstream);
/// Window means of an image and of its square.
void window_means(const at::Tensor& image, at::Tensor& mean, at::Tensor& square);
}  // namespace cpu

namespace cuda {  // float
/// On the current stream of the images' device; no waiting. At most kMostPairs pairs.
/// @throws DeviceError.
SsimValues similarity(const SsimBatch& batch);
std::vector<at::Tensor> similarity_gradients(const SsimBatch& batch,
                                             const std::vector<at::Tensor>& kept,
                                             const SsimUpstream& upstream);
}  // namespace cuda

}  // namespace jade::imaging
