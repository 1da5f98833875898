// SPDX-License-Identifier: Apache-2.0
// The relocation, growth and noise of 3DGS-MCMC (Kheradmand et al., NeurIPS 2024). Used by
// densify.cpp.
#pragma once

#include <ATen/core/Generator.h>
#include <cstdint>
#include <torch/types.h>

#include "jade/gaussians/gaussian_model.h"
#include "jade/gaussians/optimizer.h"

namespace jade::gaussians {

/// Children of a split, and spread copies, are smaller by this log scale (3DGS: 0.8 · number of
/// children).
constexpr double kSplitShrink = 0.47000362924573563;  // log 1.6

/// How Gaussians are copied.
struct CopyRule {
  double min_opacity = 0;  ///< Gaussians with a lower opacity are dead
  /// Copies are sampled from the Gaussian and made smaller by kSplitShrink; else they share its
  /// centre.
  bool spread = false;
  /// [N] relative probability of copying each living Gaussian; undefined, or all 0: its opacity
  torch::Tensor weights = {};
};

/// Moves every dead Gaussian to the place of a living one; all Gaussians at one place get the
/// opacity and scale that preserve the image (Eq. 9 of the paper). Resets their Adam moments.
/// Returns how many moved.
int64_t relocate_dead(const CopyRule& rule, GaussianModel& model, GaussianAdam& adam,
                      at::Generator& generator);

/// Adds `count` copies of living Gaussians in the same way. Returns `count`, or 0 if none is alive.
int64_t add_on_living(int64_t count, const CopyRule& rule, GaussianModel& model, GaussianAdam& adam,
                      at::Generator& generator);

/// Adds Σ ε · `scale` to the means, ε normal, damped for opaque Gaussians (Eq. 8 of the paper).
/// Takes one sample from the generator; never waits for the device.
void add_noise(double scale, GaussianModel& model, at::Generator& generator);

/// [count] rows sampled with replacement, with probabilities proportional to their weights. Sums
/// are in double, because float32 loses the last of millions of rows; torch's multinomial is
/// limited to 2^24 rows.
/// @param weights  [N] on the CPU, non-negative, not all zero
torch::Tensor drawn_rows(const torch::Tensor& weights, int64_t count, at::Generator& generator);

/// [M,3] = R(q) (exp(s) ⊙ x): converts points in a Gaussian's own axes and units to world offsets.
torch::Tensor world_offsets(const torch::Tensor& rotations, const torch::Tensor& log_scales,
                            const torch::Tensor& x);

}  // namespace jade::gaussians
