// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/regularization.h"

#include <torch/csrc/autograd/custom_function.h>

#include "jade/gaussians/regularization_kernels.h"
#include "jade/kernel/on_cuda.h"

namespace jade::gaussians {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::tensor_list;
using torch::autograd::Variable;

/// For GPUs, where torch's operations would need sixteen launches.
struct OnCuda : torch::autograd::Function<OnCuda> {
  static Variable forward(AutogradContext* ctx, const Variable& logit_opacities,
                          const Variable& log_scales, double opacity_weight, double scale_weight) {
    Variable value = torch::empty({}, log_scales.options());
    cuda::regularization(
        {logit_opacities.contiguous(), log_scales.contiguous(), opacity_weight, scale_weight},
        value);
    ctx->save_for_backward({logit_opacities, log_scales});
    ctx->saved_data["opacity_weight"] = opacity_weight;
    ctx->saved_data["scale_weight"] = scale_weight;
    return value;
  }

  static tensor_list backward(AutogradContext* ctx, const tensor_list& of_outputs) {
    const tensor_list saved = ctx->get_saved_variables();
    torch::Tensor of_logits = torch::empty(saved[0].sizes(), saved[0].options());
    torch::Tensor of_log_scales = torch::empty(saved[1].sizes(), saved[1].options());
    cuda::regularization_gradient(
        {saved[0].contiguous(), saved[1].contiguous(), ctx->saved_data["opacity_weight"].toDouble(),
         ctx->saved_data["scale_weight"].toDouble()},
        of_outputs[0].contiguous(), of_logits, of_log_scales);
    return {of_logits, of_log_scales, torch::Tensor(), torch::Tensor()};
  }
};

}  // namespace

torch::Tensor mean_opacity_and_scale(const torch::Tensor& logit_opacities,
                                     const torch::Tensor& log_scales, double opacity_weight,
                                     double scale_weight) {
  if (log_scales.is_cuda() && log_scales.scalar_type() == torch::kFloat32 &&
      log_scales.numel() > 0) {
    return kernel::on_cuda("the regularization of MCMC", [&] {
      return OnCuda::apply(logit_opacities, log_scales, opacity_weight, scale_weight);
    });
  }
  return opacity_weight * logit_opacities.sigmoid().mean() + scale_weight * log_scales.exp().mean();
}

}  // namespace jade::gaussians
