// SPDX-License-Identifier: Apache-2.0
// The splatting op: renders N Gaussians for C cameras in one differentiable call.
#pragma once

#include "jade/splat/gaussians.h"
#include "jade/splat/tensor.h"

namespace jade::splat {

/// C pinhole cameras of one image size. OpenCV axes (x right, y down, z forward).
struct CameraBatch {
  Tensor camera_from_world;  ///< [C,4,4], rigid; differentiable
  Tensor intrinsics;         ///< [C,4]: fx, fy, cx, cy in px; constant
  int64_t width = 0;
  int64_t height = 0;
};

/// Statistics of each Gaussian for densification. Backward passes add to these tensors in place, on
/// their device and without synchronisation, so one set can accumulate many steps.
struct ScreenStatistics {
  Tensor gradient_norm;  ///< [N] sum of ‖dL/dmean2d‖, mean2d in NDC (px · 2 / image size)
  Tensor visible_count;  ///< [N] number of those views in which it was visible
  Tensor max_radius_px;  ///< [N] largest screen radius: 3 σ of the longer axis

  /// All zero; float32.
  static ScreenStatistics zeros(int64_t size, Device device);
  bool defined() const { return gradient_norm.defined(); }
};

struct RenderOptions {
  int sh_degree = 3;           ///< active degree; limited to that of `sh`
  double near_plane = 0.01;    ///< Gaussians with a mean nearer than this are culled
  bool antialiased = false;    ///< scales opacity by sqrt(det Σ2d / det dilated Σ2d)
  bool deterministic = false;  ///< CUDA only: no atomics on gradients. The CPU is always
                               ///< deterministic.
  bool depth = false;          ///< also render the expected depth
  Tensor background;           ///< [3], differentiable; undefined is black

  ScreenStatistics statistics;    ///< accumulators for the backward pass; undefined: none
  int64_t statistics_views = -1;  ///< number of views, from the first, that contribute; -1: all

  /// For gradient tests only: fades α in between 1/255 and 2/255 and never stops a pixel early, so
  /// that the image is a differentiable function of every input.
  bool smooth_cutoff = false;
};

struct RenderOutput {
  Tensor color;  ///< [C,3,H,W], background included; not clamped above
  Tensor alpha;  ///< [C,1,H,W], 1 − final transmittance
  Tensor depth;  ///< [C,1,H,W], Σ w z / Σ w (0 where nothing is); undefined unless requested
  ScreenStatistics statistics;  ///< the accumulators of the options, filled by the backward pass
  Tensor rejected;              ///< [1] int64 on the device: Gaussians with unusable parameters
};

/// Renders every camera of the batch.
///
/// Per pixel, front to back in the order of (depth, index):
///     α_i = min(0.99, o_i · exp(−q_i / 2)),  skipped below 1/255,
///     C = Σ c_i α_i T_i + T_end · background,  T_{i+1} = T_i (1 − α_i),
/// ending before the Gaussian that would reduce T to 1e-4 or less. q_i is the squared Mahalanobis
/// distance of the pixel centre (x + 0.5, y + 0.5) under Σ2d + 0.3 px² I; c_i = max(0,
/// SH(direction) + 0.5).
///
/// Differentiable in all Gaussian parameters, `background` and `camera_from_world`, once. Gaussians
/// with non-finite or out-of-range parameters (see math/projection.h) contribute nothing, get zero
/// gradients and are counted in `rejected`. The image depends on neither tile size, thread count
/// nor batch; CPU results, gradients included, are bit-identical for any thread count.
///
/// @throws ContractError for shapes, dtypes and devices that do not match, DeviceError for a CUDA
///   tensor in a build without CUDA kernels.
RenderOutput render(const Gaussians& gaussians, const CameraBatch& cameras,
                    const RenderOptions& options);

}  // namespace jade::splat
