// SPDX-License-Identifier: Apache-2.0
#include "jade/losses/poses.h"

#include <torch/csrc/autograd/custom_function.h>

#include "jade/core/check.h"
#include "jade/kernel/on_cuda.h"
#include "jade/losses/poses_kernels.h"

namespace jade::losses {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

class PoseViewsFunction : public torch::autograd::Function<PoseViewsFunction> {
 public:
  /// @return the renders, the mean, then the picks
  static variable_list forward(AutogradContext* context, const torch::Tensor& renders,
                               const PosePicks& picks) {
    context->set_materialize_grads(false);
    context->save_for_backward({picks.indices, picks.weights});
    context->saved_data["first"] = picks.first;
    context->saved_data["shape"] = renders.sizes().vec();
    if (renders.is_cuda()) return on_gpu(renders, picks);
    variable_list out{renders, mean_on_cpu(renders, picks.weights)};
    if (picks.first >= 0) out.push_back(renders[picks.first].clone());
    const auto* const indices = picks.indices.const_data_ptr<int64_t>();
    for (int64_t m = 0; m < picks.indices.numel(); ++m) out.push_back(renders[indices[m]].clone());
    return out;
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const variable_list saved = context->get_saved_variables();
    PosePicks picks;
    picks.indices = saved[0];
    picks.weights = saved[1];
    picks.first = context->saved_data["first"].toInt();
    torch::Tensor result;
    for (torch::Tensor& gradient : gradients) {
      if (!gradient.defined()) continue;
      gradient = gradient.contiguous();
      result = torch::empty(context->saved_data["shape"].toIntVector(), gradient.options());
    }
    if (result.defined()) {
      const PoseGradients of{gradients[1], {gradients.begin() + 2, gradients.end()}, gradients[0]};
      if (result.is_cuda()) {
        kernel::on_cuda("the mean of the renders", [&] { cuda::pose_gradient(picks, of, result); });
      } else {
        cpu::pose_gradient(picks, of, result);
      }
    }
    return {result, torch::Tensor()};
  }

 private:
  static torch::Tensor mean_on_cpu(const torch::Tensor& renders, const torch::Tensor& weights) {
    if (!weights.defined()) return renders.mean(0);
    torch::Tensor mean = torch::empty_like(renders[0], torch::MemoryFormat::Contiguous);
    cpu::weighted_sum(renders.contiguous(), weights, mean);
    return mean;
  }

  static variable_list on_gpu(const torch::Tensor& renders, const PosePicks& picks) {
    const torch::Tensor like = renders[0];
    torch::Tensor mean = torch::empty_like(like);
    variable_list picked;
    for (int64_t m = 0; m < picks.count(); ++m) picked.push_back(torch::empty_like(like));
    kernel::on_cuda("the mean of the renders",
                    [&] { cuda::pose_views(picks, renders.contiguous(), mean, picked); });
    picked.insert(picked.begin(), {renders, mean});
    return picked;
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
                     const torch::Tensor& weights, int64_t first) {
  check_shape(renders, "renders", {-1, 3, -1, -1});
  if (renders.is_cuda()) check_dtype(renders, "renders on a GPU", torch::kFloat32);
  check_dtype(pose_indices, "pose indices", torch::kInt64);
  check_same_device(renders, "renders", pose_indices, "pose indices");
  PosePicks picks;
  picks.indices = pose_indices.contiguous();
  picks.first = first;
  if (weights.defined()) {
    check_shape(weights, "weights of the renders", {renders.size(0)});
    picks.weights = weights.to(renders.scalar_type()).contiguous();
  }
  JADE_CHECK(!renders.is_cuda() || picks.count() <= kMostPicks, "expected at most ", kMostPicks,
             " picks of the renders, found ", picks.count());
  variable_list outputs = PoseViewsFunction::apply(renders, picks);
  PoseViews views;
  views.all = outputs[0];
  views.mean = outputs[1];
  views.picks.assign(outputs.begin() + 2, outputs.end());
  return views;
}

}  // namespace jade::losses
