// SPDX-License-Identifier: Apache-2.0
#include "jade/losses/poses.h"

#include <torch/csrc/autograd/custom_function.h>

#include "jade/core/check.h"

namespace jade::losses {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

class PoseViewsFunction : public torch::autograd::Function<PoseViewsFunction> {
 public:
  static variable_list forward(AutogradContext* context, const torch::Tensor& renders,
                               const torch::Tensor& pose_indices) {
    context->save_for_backward({pose_indices});
    context->saved_data["count"] = renders.size(0);
    return {renders.mean(0), renders.index_select(0, pose_indices)};
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const torch::Tensor pose_indices = context->get_saved_variables()[0];
    const int64_t count = context->saved_data["count"].toInt();
    const torch::Tensor& of_mean = gradients[0];
    const torch::Tensor& of_picks = gradients[1];
    std::vector<int64_t> shape = of_mean.sizes().vec();
    shape.insert(shape.begin(), count);
    torch::Tensor result = torch::empty(shape, of_mean.options());
    result.copy_((of_mean / static_cast<double>(count)).unsqueeze(0).expand(shape));
    // One at a time, so that repeated poses add up in a fixed order on every device.
    for (int64_t i = 0; i < pose_indices.size(0); ++i) {
      result.index_add_(0, pose_indices.narrow(0, i, 1), of_picks.narrow(0, i, 1));
    }
    return {result, torch::Tensor()};
  }
};

}  // namespace

PoseViews pose_views(const torch::Tensor& renders, const torch::Tensor& pose_indices) {
  check_shape(renders, "renders", {-1, 3, -1, -1});
  check_dtype(pose_indices, "pose indices", torch::kInt64);
  const variable_list outputs = PoseViewsFunction::apply(renders, pose_indices);
  return {outputs[0], outputs[1]};
}

}  // namespace jade::losses
