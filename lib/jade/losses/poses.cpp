// SPDX-License-Identifier: Apache-2.0
#include "jade/losses/poses.h"

#include <optional>
#include <torch/csrc/autograd/custom_function.h>

#include "jade/core/check.h"

namespace jade::losses {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

class PoseViewsFunction : public torch::autograd::Function<PoseViewsFunction> {
 public:
  static variable_list forward(AutogradContext* context, const torch::Tensor& renders,
                               const torch::Tensor& pose_indices,
                               const std::optional<torch::Tensor>& given) {
    const torch::Tensor weights = given.value_or(torch::Tensor());
    context->save_for_backward({pose_indices, weights});
    context->saved_data["count"] = renders.size(0);
    return {weighted_mean(renders, weights), renders.index_select(0, pose_indices)};
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const variable_list saved = context->get_saved_variables();
    const torch::Tensor &pose_indices = saved[0], &weights = saved[1];
    const int64_t count = context->saved_data["count"].toInt();
    const torch::Tensor& of_mean = gradients[0];
    const torch::Tensor& of_picks = gradients[1];
    std::vector<int64_t> shape = of_mean.sizes().vec();
    shape.insert(shape.begin(), count);
    torch::Tensor result = torch::empty(shape, of_mean.options());
    if (weights.defined()) {
      torch::mul_out(result, of_mean.unsqueeze(0),
                     weights.to(of_mean.scalar_type()).view({-1, 1, 1, 1}));
    } else {
      result.copy_((of_mean / static_cast<double>(count)).unsqueeze(0).expand(shape));
    }
    // One at a time, so that repeated poses add up in a fixed order on every device.
    for (int64_t i = 0; i < pose_indices.size(0); ++i) {
      result.index_add_(0, pose_indices.narrow(0, i, 1), of_picks.narrow(0, i, 1));
    }
    return {result, torch::Tensor(), torch::Tensor()};
  }
};

}  // namespace

torch::Tensor weighted_mean(const torch::Tensor& renders, const torch::Tensor& weights) {
  if (!weights.defined()) return renders.mean(0);
  check_shape(weights, "weights of the renders", {renders.size(0)});
  std::vector<int64_t> shape(static_cast<size_t>(renders.dim()), 1);
  shape[0] = -1;
  return (renders * weights.to(renders.scalar_type()).view(shape)).sum(0);
}

PoseViews pose_views(const torch::Tensor& renders, const torch::Tensor& pose_indices,
                     const torch::Tensor& weights) {
  check_shape(renders, "renders", {-1, 3, -1, -1});
  check_dtype(pose_indices, "pose indices", torch::kInt64);
  const variable_list outputs =
      PoseViewsFunction::apply(renders, pose_indices, std::optional<torch::Tensor>(weights));
  return {outputs[0], outputs[1]};
}

}  // namespace jade::losses
