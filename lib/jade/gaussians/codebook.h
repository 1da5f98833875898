// SPDX-License-Identifier: Apache-2.0
// Vector quantisation. Private to this folder.
#pragma once

#include <cstdint>
#include <torch/types.h>

namespace jade::gaussians {

/// Numbers quantised to the nearest of 256 values.
struct Codebook {
  torch::Tensor values;  ///< [256] float64, ascending
  torch::Tensor labels;  ///< uint8, shape of the numbers
};

/// The 256 values with the least squared distances, by Lloyd's iterations from the mean of
/// quantiles and even steps.
/// @param numbers  not empty, finite
Codebook codebook_of(const torch::Tensor& numbers);

/// Rows quantised to the nearest row of a palette.
struct Palette {
  torch::Tensor rows;    ///< [P,D] float32
  torch::Tensor labels;  ///< [N] int64
};

/// At most `at_most` rows, found by k-means in two steps: 256 groups, and within each its share of
/// the palette. Returns the rows themselves if there are no more than that. Deterministic.
/// @param rows  [N,D]
Palette palette_of(const torch::Tensor& rows, int64_t at_most);

}  // namespace jade::gaussians
