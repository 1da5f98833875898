// SPDX-License-Identifier: Apache-2.0
// Packed quaternions of files. Private to this folder.
#pragma once

#include <torch/types.h>

namespace jade::gaussians {

/// Unit quaternions without their largest component, which is made positive and computed from the
/// others.
struct SmallestThree {
  torch::Tensor largest;  ///< [N] int64, index of the omitted component, 0 to 3
  torch::Tensor others;   ///< [N,3], the other components in their order, within ±1/√2
};

/// @param quaternions  [N,4] of any norm; zero counts as the first unit vector
SmallestThree smallest_three(const torch::Tensor& quaternions);

/// [N,4] unit quaternions.
torch::Tensor joined(const SmallestThree& parts);

/// [N] int64: two bits of the largest component, then ten bits of each other one.
/// @param fields  [N,3] int64, 0 to 1023
torch::Tensor packed_32(const torch::Tensor& largest, const torch::Tensor& fields);

/// The fields [N,3] of packed_32().
torch::Tensor fields_of(const torch::Tensor& packed);

}  // namespace jade::gaussians
