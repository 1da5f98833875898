// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

namespace jade::test {

/// Difference between the gradient norms of splat::ScreenStatistics and more accurate ones, [N]
/// both.
struct NormDifference {
  double beyond_rounding = 0;  ///< share of the Gaussians that differ by more than float32 rounding
  double largest = 0;          ///< of all differences, in units of the mean norm
};

/// A norm is that of a sum over pixels whose terms have either sign, so rounding is relative to the
/// terms and not to their sum: float32 on the CPU is within 2e-4 of the mean norm of float64 for
/// every Gaussian with the same cut-offs. The bound is 1e-3 of the norm and 1e-3 of the mean, which
/// leaves a factor of five for other orders of summation (atomics) and for faster exponentials and
/// quotients.
/// Larger differences are cut-offs at α = 1/255 that differ at a pixel: one Gaussian in a thousand
/// then gains or loses a term of a fraction of the mean norm.
inline NormDifference compare_gradient_norms(const torch::Tensor& norms,
                                             const torch::Tensor& better) {
  const torch::Tensor truth = better.to(torch::kFloat64);
  const torch::Tensor difference = (norms.to(torch::kFloat64) - truth).abs();
  const double mean = truth.masked_select(truth > 0).mean().item<double>();
  const torch::Tensor beyond = difference > 1e-3 * truth + 1e-3 * mean;
  return {beyond.to(torch::kFloat64).mean().item<double>(), difference.max().item<double>() / mean};
}

/// The limits to these, for 2,000 Gaussians seen three times.
inline constexpr double kBeyondRounding = 2e-3;
inline constexpr double kLargestFlip = 0.2;

}  // namespace jade::test
