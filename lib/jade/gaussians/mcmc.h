// SPDX-License-Identifier: Apache-2.0
// The moves of 3DGS-MCMC (Kheradmand et al., NeurIPS 2024). Used by densify.cpp.
#pragma once

#include <ATen/core/Generator.h>
#include <cstdint>
#include <torch/types.h>

#include "jade/gaussians/gaussian_model.h"
#include "jade/gaussians/optimizer.h"

namespace jade::gaussians {

/// Children of a split, and spread copies, are this much smaller in log scale (3DGS: 0.8 · number
/// of children).
constexpr double kSplitShrink = 0.47000362924573563;  // log 1.6

/// How Gaussians are copied.
struct CopyRule {
  double min_opacity = 0;  ///< fainter ones are dead
  /// The copies are drawn from the Gaussian and made smaller by kSplitShrink; else they share its
  /// centre.
  bool spread = false;
  /// [N] how likely each living one is copied; undefined, or 0 for all of them: its opacity
  torch::Tensor weights = {};
};

/// Moves every dead Gaussian onto a living one; all that share a place get the opacity and scale
/// that keep the image (Eq. 9 of the paper). Their Adam moments start anew. Returns how many moved.
int64_t relocate_dead(const CopyRule& rule, GaussianModel& model, GaussianAdam& adam,
                      at::Generator& generator);

/// Adds `count` Gaussians on living ones in the same way. Returns `count`, or 0 where none lives.
int64_t add_on_living(int64_t count, const CopyRule& rule, GaussianModel& model, GaussianAdam& adam,
                      at::Generator& generator);

/// Moves the means by Σ ε · `scale`, ε normal, damped for opaque Gaussians (Eq. 8 of the paper).
/// One draw from the generator; never waits for the device.
void add_noise(double scale, GaussianModel& model, at::Generator& generator);

/// [count] rows sampled with replacement, each as likely as its weight. Sums are in double, as
/// float32 loses the late ones of millions of rows; torch's multinomial takes 2^24 rows at most.
/// @param weights  [N] on the CPU, none below 0, some above
torch::Tensor drawn_rows(const torch::Tensor& weights, int64_t count, at::Generator& generator);

/// [M,3] = R(q) (exp(s) ⊙ x): points in a Gaussian's own axes and units as world offsets.
torch::Tensor world_offsets(const torch::Tensor& rotations, const torch::Tensor& log_scales,
                            const torch::Tensor& x);

}  // namespace jade::gaussians
