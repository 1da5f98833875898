// SPDX-License-Identifier: Apache-2.0
// Linear interpolation in a table of φ, apart from autograd. Not for use outside this folder.
#pragma once

#include <cstdint>
#include <torch/types.h>

namespace jade::models {

/// The table's knots are linspace(0, 2, 4097); beyond them the outermost cells go on.
constexpr int64_t kCrfKnots = 4097;
constexpr double kCrfRange = 2;

/// All tensors contiguous, of one floating type and device.
struct CrfLookup {
  torch::Tensor image;  ///< [K, P...]
  torch::Tensor table;  ///< [kCrfKnots]
  bool mean = false;    ///< average over the first dimension
};

struct CrfGradient {
  torch::Tensor image;  ///< undefined unless wanted
  torch::Tensor table;
};

namespace cpu {
torch::Tensor crf_lookup(const CrfLookup& args);
CrfGradient crf_lookup_backward(const CrfLookup& args, const torch::Tensor& gradient,
                                bool wants_image, bool wants_table);
}  // namespace cpu

namespace cuda {
torch::Tensor crf_lookup(const CrfLookup& args);
CrfGradient crf_lookup_backward(const CrfLookup& args, const torch::Tensor& gradient,
                                bool wants_image, bool wants_table);
}  // namespace cuda

}  // namespace jade::models
