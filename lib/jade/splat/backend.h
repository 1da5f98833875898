// SPDX-License-Identifier: Apache-2.0
// The interface between the op (render.cpp, autograd.cpp) and its two backends: plain tensors and
// scalars, no autograd. One call handles all views.
#pragma once

#include <cstdint>
#include <vector>

#include "jade/splat/gaussians.h"
#include "jade/splat/math/blend.h"
#include "jade/splat/render.h"
#include "jade/splat/tensor.h"

namespace jade::splat {

/// A value of sh_degree: `sh` [N,1,3] contains colours of any sign, which are blended unchanged.
constexpr int kPlainColor = -1;
constexpr double kFarthest = 1e12;

/// Checked by the caller: contiguous, detached, one dtype and device, N may be 0, C and the image
/// size are at least 1.
struct ForwardArgs {
  Gaussians gaussians;
  Tensor camera_from_world;  ///< [C,4,4]
  Tensor intrinsics;         ///< [C,4] or matrices [C,3,3]; dtype and device of the Gaussians
  Tensor background;         ///< [3]; undefined: black
  int64_t width = 0;
  int64_t height = 0;
  int sh_degree = 0;  ///< active degree, at most that of `sh`; kPlainColor
  double near_plane = 0.01;
  double far_plane = kFarthest;  ///< Gaussians with a mean farther away are culled
  double max_alpha = math::kMaxAlpha;
  bool activated = false;  ///< scales and opacities instead of logarithms and logits
  bool antialiased = false;
  bool depth = false;
  bool smooth_cutoff = false;
  bool deterministic = false;
  bool interleaved = false;     ///< color and its gradient are [C,H,W,3], alpha [C,H,W,1]
  bool needs_backward = false;  ///< false: `state` may stay empty
};

/// State that a backend's forward pass stores for its backward pass. The op stores it with the
/// graph, reads only `cleared`, and passes that on once. A CUDA graph must therefore contain both
/// passes, or replay the forward pass before every backward pass.
struct SavedState {
  std::vector<Tensor> tensors;
  std::vector<int64_t> numbers;
  Tensor cleared;  ///< zeros that the first backward call consumes; later ones have none
};

struct ForwardResult {
  Tensor color;      ///< [C,3,H,W] or interleaved, background included
  Tensor alpha;      ///< [C,1,H,W]
  Tensor depth_sum;  ///< [C,1,H,W], Σ w z, not divided by alpha; undefined unless requested
  Tensor rejected;   ///< [1] int64 on the device
  SavedState state;
};

struct BackwardArgs {
  ForwardArgs forward;  ///< the same as in the forward call
  SavedState state;
  Tensor color, alpha, depth_sum;                 ///< outputs of the forward call
  Tensor grad_color, grad_alpha, grad_depth_sum;  ///< contiguous; undefined means zero
  ScreenStatistics statistics;                    ///< float32 accumulators to add to, or undefined
  int64_t statistics_views = -1;  ///< number of views, from the first, that contribute; -1: all
  bool needs_camera = false;
  bool needs_background = false;  ///< whether there is a background
  bool needs_means2d = false;
};

/// Shaped as the inputs. Every element is written; unneeded gradients stay undefined.
struct BackwardResult {
  Gaussians gaussians;
  Tensor camera_from_world;
  Tensor background;
  Tensor means2d;  ///< [C,N,2] in px, 0 where a Gaussian is not visible
};

/// Uninitialised images of all views with that many channels, in the call's layout.
inline Tensor new_images(const ForwardArgs& args, int64_t channels) {
  const Tensor& like = args.gaussians.means;
  const int64_t views = args.camera_from_world.size(0);
  if (args.interleaved) {
    return new_tensor({views, args.height, args.width, channels}, like.scalar_type(), like);
  }
  return new_tensor({views, channels, args.height, args.width}, like.scalar_type(), like);
}

namespace cpu {
ForwardResult forward(const ForwardArgs& args);  ///< float or double
BackwardResult backward(const BackwardArgs& args);
}  // namespace cpu

namespace cuda {
ForwardResult forward(const ForwardArgs& args);  ///< float
BackwardResult backward(const BackwardArgs& args);
}  // namespace cuda

}  // namespace jade::splat
