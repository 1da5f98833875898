// SPDX-License-Identifier: Apache-2.0
// Vectors and numbers as indices of few representatives. Not for use outside this folder.
#pragma once

#include <cstdint>
#include <torch/types.h>

namespace jade::gaussians {

/// Numbers by the nearest of 256.
struct Codebook {
  torch::Tensor values;  ///< [256] float64, ascending
  torch::Tensor labels;  ///< uint8, shape of the numbers
};

/// The 256 numbers with the least squared distances, to which Lloyd's iterations lead from the mean
/// of quantiles and even steps.
/// @param numbers  not empty, finite
Codebook codebook_of(const torch::Tensor& numbers);

/// Rows by the nearest of a palette.
struct Palette {
  torch::Tensor rows;    ///< [P,D] float32
  torch::Tensor labels;  ///< [N] int64
};

/// At most `at_most` rows, found by k-means in two stages: 256 groups, and in each its share of the
/// palette. The rows themselves where they are no more than that. Deterministic.
/// @param rows  [N,D]
Palette palette_of(const torch::Tensor& rows, int64_t at_most);

}  // namespace jade::gaussians
