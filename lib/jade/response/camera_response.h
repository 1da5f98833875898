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

/// An image whose response is asked for together with that of others.
struct ResponseInput {
  torch::Tensor image;    ///< any shape; [K,...] where it has weights
  torch::Tensor weights;  ///< [K], constant: Σ_k w_k ρ(image[k]) is asked for; undefined: ρ(image)
};

/// The camera response ρ(x) = sigmoid(0.1 · MLP(x) + x), a scalar map applied to every channel
/// value, with MLP 1→16→16→16→1 and ReLU between. It starts as a fit of the identity on [0,1]
/// from a file: always the same one. The inherited recipe stops 0.007 from the identity on
/// average and 0.034 at worst (near 0 and 1, where the sigmoid needs a logit without bound).
///
/// Whole images go through ρ several times per step, yet ρ is a function of one number: forward()
/// reads it from a table of ρ at 4097 knots over [0,2] and interpolates linearly, which differs
/// from the network by less than 1e-4 (a test says so). Gradients reach the parameters through the
/// knots. A GPU sees one short kernel per call, for all images of the call.
class CameraResponseImpl : public torch::nn::Module {
 public:
  /// @throws DataError as identity_response().
  CameraResponseImpl();

  /// ρ at the knots, [4097], differentiable in the parameters. One table serves every image of a
  /// step; with ρ held fixed, make it once under NoGradGuard.
  torch::Tensor table();

  /// All that is asked for in one call, differentiable in the images and in the table, whose
  /// gradient is added up once. On a GPU at most 8 images, whose weights may lie on the CPU: up to
  /// 40 are not copied but travel with the launch.
  static std::vector<torch::Tensor> apply_all(const std::vector<ResponseInput>& inputs,
                                              const torch::Tensor& table);

  /// ρ(image), element-wise, differentiable in the image and in the table.
  static torch::Tensor apply(const torch::Tensor& image, const torch::Tensor& table);

  /// Σ_k w_k ρ(images[k]): [K,...] → [...], without keeping the single ρ(images[k]).
  /// @param weights  [K] on the images' device, constant; undefined: 1/K each.
  static torch::Tensor mean(const torch::Tensor& images, const torch::Tensor& table,
                            const torch::Tensor& weights = {});

  torch::Tensor forward(const torch::Tensor& image, const torch::Tensor& table) {
    return apply(image, table);
  }
  /// Makes a table for this one call.
  torch::Tensor forward(const torch::Tensor& image) { return apply(image, table()); }

  /// ρ through the MLP itself: slow, for tests.
  torch::Tensor exact(const torch::Tensor& image);

  torch::nn::Linear layer1{nullptr}, layer2{nullptr}, layer3{nullptr}, layer4{nullptr};

 private:
  torch::Tensor mlp(const torch::Tensor& values);
};
TORCH_MODULE(CameraResponse);

}  // namespace jade::response
