// SPDX-License-Identifier: Apache-2.0
#include "jade/splat/autograd.h"

#include <torch/csrc/autograd/custom_function.h>
#include <utility>

#include "jade/core/check.h"
#include "jade/kernel/on_cuda.h"

namespace jade::splat {

namespace {

using torch::autograd::AutogradContext;
using torch::autograd::tensor_list;
using torch::autograd::Variable;

ForwardResult backend_forward(const ForwardArgs& args) {
  if (!args.gaussians.means.is_cuda()) return cpu::forward(args);
  return kernel::on_cuda("splatting", [&] { return cuda::forward(args); });
}

BackwardResult backend_backward(const BackwardArgs& args) {
  if (!args.forward.gaussians.means.is_cuda()) return cpu::backward(args);
  return kernel::on_cuda("splatting", [&] { return cuda::backward(args); });
}

torch::Tensor contiguous_or_undefined(const torch::Tensor& tensor) {
  return tensor.defined() ? tensor.contiguous() : tensor;
}

/// The scalars of ForwardArgs and the accumulators of statistics, which have no gradients.
struct Settings : torch::CustomClassHolder {
  ForwardArgs scalars;  ///< its tensors are undefined
  bool black = false;   ///< no background; autograd requires every input to be defined, so a
                        ///< placeholder is passed
  std::vector<int64_t> state_numbers;
  torch::Tensor cleared;  ///< SavedState's, until the first backward call
  ScreenStatistics statistics;
  int64_t statistics_views = -1;
};

constexpr size_t kInputs = 8;

ForwardArgs with_inputs(const Settings& settings, const std::vector<Variable>& in) {
  ForwardArgs args = settings.scalars;
  args.gaussians = {in[0], in[1], in[2], in[3], in[4]};
  args.camera_from_world = in[5];
  if (!settings.black) args.background = in[6];
  args.intrinsics = in[7];
  return args;
}

struct Splatting : torch::autograd::Function<Splatting> {
  static tensor_list forward(AutogradContext* ctx, const Variable& means, const Variable& rotations,
                             const Variable& log_scales, const Variable& logit_opacities,
                             const Variable& sh, const Variable& camera_from_world,
                             const Variable& background, const Variable& intrinsics,
                             const c10::intrusive_ptr<Settings>& settings) {
    const tensor_list inputs = {means, rotations,         log_scales, logit_opacities,
                                sh,    camera_from_world, background, intrinsics};
    ForwardResult result = backend_forward(with_inputs(*settings, inputs));
    settings->state_numbers = result.state.numbers;
    settings->cleared = result.state.cleared;
    if (settings->scalars.needs_backward) {
      tensor_list saved = inputs;
      saved.insert(saved.end(), {result.color, result.alpha, result.depth_sum});
      saved.insert(saved.end(), result.state.tensors.begin(), result.state.tensors.end());
      ctx->save_for_backward(saved);
      ctx->saved_data["settings"] = c10::IValue::make_capsule(settings);
    }
    ctx->mark_non_differentiable({result.rejected});
    ctx->set_materialize_grads(false);
    tensor_list outputs = {result.color, result.alpha, result.rejected};
    if (result.depth_sum.defined()) outputs.push_back(result.depth_sum);
    return outputs;
  }

  static tensor_list backward(AutogradContext* ctx, const tensor_list& grads) {
    const auto capsule = ctx->saved_data["settings"].toCapsule();
    auto& settings = static_cast<Settings&>(*capsule);
    const tensor_list saved = ctx->get_saved_variables();
    BackwardArgs args;
    args.forward = with_inputs(settings, saved);
    args.color = saved[kInputs];
    args.alpha = saved[kInputs + 1];
    args.depth_sum = saved[kInputs + 2];
    args.state.tensors.assign(saved.begin() + kInputs + 3, saved.end());
    args.state.numbers = settings.state_numbers;
    args.state.cleared = std::move(settings.cleared);
    args.grad_color = contiguous_or_undefined(grads[0]);
    args.grad_alpha = contiguous_or_undefined(grads[1]);
    if (grads.size() > 3) args.grad_depth_sum = contiguous_or_undefined(grads[3]);
    args.statistics = settings.statistics;
    args.statistics_views = settings.statistics_views;
    args.needs_camera = ctx->needs_input_grad(5);
    args.needs_background = ctx->needs_input_grad(6);
    const BackwardResult result = backend_backward(args);
    const Gaussians& g = result.gaussians;
    return {g.means,
            g.rotations,
            g.log_scales,
            g.logit_opacities,
            g.sh,
            result.camera_from_world,
            result.background,
            torch::Tensor(),
            torch::Tensor()};
  }
};

}  // namespace

BlendedImages blend_images(const ForwardArgs& args, const ScreenStatistics& statistics,
                           int64_t statistics_views) {
  const Gaussians& g = args.gaussians;
  auto settings = c10::make_intrusive<Settings>();
  settings->scalars = args;
  settings->scalars.gaussians = {};
  settings->scalars.camera_from_world = settings->scalars.background =
      settings->scalars.intrinsics = torch::Tensor();
  settings->scalars.needs_backward = false;
  for (const auto& t : {g.means, g.rotations, g.log_scales, g.logit_opacities, g.sh,
                        args.camera_from_world, args.background}) {
    settings->scalars.needs_backward |=
        t.defined() && t.requires_grad() && torch::GradMode::is_enabled();
  }
  settings->statistics = statistics;
  settings->statistics_views = statistics_views;
  settings->black = !args.background.defined();
  const tensor_list out = Splatting::apply(
      g.means, g.rotations, g.log_scales, g.logit_opacities, g.sh, args.camera_from_world,
      settings->black ? args.intrinsics : args.background, args.intrinsics, settings);
  return {out[0], out[1], out.size() > 3 ? out[3] : torch::Tensor(), out[2]};
}

}  // namespace jade::splat
