// SPDX-License-Identifier: Apache-2.0
// Linear interpolation in a table of φ, apart from autograd. Not for use outside this folder.
#pragma once

#include <ATen/core/Tensor.h>
#include <cstdint>

namespace jade::models {

/// The table's knots are linspace(0, 2, 4097); beyond them the outermost cells go on.
constexpr int64_t kCrfKnots = 4097;
constexpr double kCrfRange = 2;

/// All tensors contiguous, of one floating type and device.
struct CrfLookup {
  at::Tensor image;   ///< [K, P...]
  at::Tensor table;   ///< [kCrfKnots]
  bool mean = false;  ///< average over the first dimension
};

struct CrfGradient {
  at::Tensor image;  ///< undefined unless wanted
  at::Tensor table;
};

namespace cpu {
at::Tensor crf_lookup(const CrfLookup& args);
CrfGradient crf_lookup_backward(const CrfLookup& args, const at::Tensor& gradient, bool wants_image,
                                bool wants_table);
}  // namespace cpu

namespace cuda {
at::Tensor crf_lookup(const CrfLookup& args);
CrfGradient crf_lookup_backward(const CrfLookup& args, const at::Tensor& gradient, bool wants_image,
                                bool wants_table);
}  // namespace cuda

}  // namespace jade::models
