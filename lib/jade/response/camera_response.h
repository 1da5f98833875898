// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/nn/module.h>
#include <torch/nn/modules/linear.h>
#include <torch/nn/pimpl.h>
#include <torch/types.h>
#include <vector>

#include "jade/core/fields.h"

namespace jade::response {

struct ResponseOptions {
  bool enabled = false;
  double lr = 1e-7;
};

template <class V>
void describe(V& v, ResponseOptions& o) {
  v.field("enabled", o.enabled, "camera response ρ in the losses; off: ρ is the identity");
  v.field("lr", o.lr, "Adam step size of ρ (crf_lr); 0 keeps the identity", Range{0, 1});
}

/// An image to which the response is applied.
struct ResponseInput {
  torch::Tensor image;    ///< any shape; [K,...] if it has weights
  torch::Tensor weights;  ///< [K], constant: computes Σ_k w_k ρ(image[k]); undefined: ρ(image)
};

/// The camera response ρ(x) = sigmoid(0.1 · MLP(x) + x), a scalar map applied to every channel
/// value, with MLP 1→16→16→16→1 and ReLU between. It is initialised from a file with a fixed fit of
/// the identity on [0,1]. The initialisation of DiET-GS differs from the identity by 0.007 on
/// average and 0.034 at worst (near 0 and 1, where the sigmoid needs an unbounded logit).
///
/// A step applies ρ to several whole images, yet ρ is a function of one number: apply_all()
/// interpolates linearly in a table of ρ at 4097 knots over [0,2], which differs from the network
/// by less than 1e-4 (tested). Gradients reach the parameters through the knots. A GPU runs one
/// short kernel per call, for all images of the call.
class CameraResponseImpl : public torch::nn::Module {
 public:
  /// @throws DataError as identity_response().
  CameraResponseImpl();

  /// ρ at the knots, [4097], differentiable in the parameters. One table serves every image of a
  /// step; with ρ fixed, compute it once under NoGradGuard.
  torch::Tensor table();

  /// Applies ρ to all images in one call, differentiable in the images and in the table, whose
  /// gradient is accumulated once. On a GPU at most 8 images, whose weights may be on the CPU: up
  /// to 40 are passed as kernel arguments without a copy.
  static std::vector<torch::Tensor> apply_all(const std::vector<ResponseInput>& inputs,
                                              const torch::Tensor& table);

  /// ρ computed by the MLP itself, element-wise.
  torch::Tensor exact(const torch::Tensor& image);

  torch::nn::Linear layer1{nullptr}, layer2{nullptr}, layer3{nullptr}, layer4{nullptr};
};
TORCH_MODULE(CameraResponse);

}  // namespace jade::response
