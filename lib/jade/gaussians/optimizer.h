// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <torch/types.h>

#include "jade/core/fields.h"
#include "jade/gaussians/gaussian_model.h"

namespace jade::gaussians {

/// Step sizes of the scene's Adam, as 3DGS has them.
struct OptimOptions {
  double position_lr_start = 1.6e-4;
  double position_lr_end = 1.6e-6;
  Steps position_lr_max_steps = Steps::share(600);
  double sh_dc_lr = 2.5e-3;
  double sh_rest_lr = 1.25e-4;
  double opacity_lr = 0.05;
  double scale_lr = 5e-3;
  double rotation_lr = 1e-3;
  double beta1 = 0.9;
  double beta2 = 0.999;
  double eps = 1e-15;
};

template <class V>
void describe(V& v, OptimOptions& o) {
  const Range rate{0, 10};
  v.field("position_lr_start", o.position_lr_start,
          "step size of the means at step 0, times the scene extent", rate);
  v.field("position_lr_end", o.position_lr_end,
          "the same at position_lr_max_steps; log-linear between", rate);
  v.field("position_lr_max_steps", o.position_lr_max_steps,
          "steps over which the means' step size falls", Range{1, 1e9});
  v.field("sh_dc_lr", o.sh_dc_lr, "step size of the base colour (SH degree 0)", rate);
  v.field("sh_rest_lr", o.sh_rest_lr, "step size of the view-dependent colour", rate);
  v.field("opacity_lr", o.opacity_lr, "step size of the opacity logits", rate);
  v.field("scale_lr", o.scale_lr, "step size of the log scales", rate);
  v.field("rotation_lr", o.rotation_lr, "step size of the quaternions", rate);
  v.field("beta1", o.beta1, "Adam's decay of the first moment", Range{0, 0.999999});
  v.field("beta2", o.beta2, "Adam's decay of the second moment", Range{0, 0.999999});
  v.field("eps", o.eps, "Adam's guard against division by zero", Range{0, 1});
}

/// Step size of the means at `step` (counted from 1) before the factor `extent`:
/// exp of the line from log(start) to log(end) over max_steps, constant after it.
double position_lr(const OptimOptions& options, int64_t step);

/// Adam over all parameters of a GaussianModel in one pass (CPU) or one kernel (CUDA). The step
/// counter lives on the device and the means' schedule is evaluated from it, so a step neither
/// synchronises nor changes arguments and can be captured in a CUDA graph.
class GaussianAdam {
 public:
  GaussianAdam() = default;
  /// @param monochrome  the three channels of every SH coefficient step alike, by the mean of their
  ///   gradients: a model that starts gray stays gray to the bit. Terms of the objective weigh the
  ///   channels differently, and kernels sum them in different orders.
  GaussianAdam(const GaussianModel& model, const OptimOptions& options, bool monochrome = false);

  /// One step with the gradients the model holds; parameters without gradient stay as they are.
  void step(GaussianModel& model);

  /// First and second moments, shaped as the parameters; rows belong to the Gaussians of the same
  /// index.
  const splat::Gaussians& first_moments() const { return first_; }
  const splat::Gaussians& second_moments() const { return second_; }
  /// [1] int64 on the device: steps done.
  const torch::Tensor& step_count() const { return step_count_; }
  const OptimOptions& options() const { return options_; }
  bool monochrome() const { return monochrome_; }

  /// Row surgery: row i becomes the old row rows[i] (int64 [M]); rows[i] = -1 starts from zero.
  void gather_rows(const torch::Tensor& rows);
  /// Zeroes the moments of one parameter (kParameterNames), as an opacity reset does.
  void reset_parameter(int index);
  /// Zeroes the moments of the rows `rows` (int64 [M]) in every parameter.
  void reset_rows(const torch::Tensor& rows);

  /// For checkpoints: shapes must fit the model. @throws ContractError.
  void restore(const splat::Gaussians& first, const splat::Gaussians& second,
               const torch::Tensor& step_count);

 private:
  OptimOptions options_;
  double extent_ = 1;
  bool monochrome_ = false;
  splat::Gaussians first_, second_;
  torch::Tensor step_count_;
};

}  // namespace jade::gaussians
