// SPDX-License-Identifier: Apache-2.0
// Linear interpolation in a table of ρ, without autograd; lookup_math.h has its arithmetic. Private
// to this folder.
#pragma once

#include <ATen/core/Tensor.h>
#include <vector>

#include "jade/response/lookup_math.h"

namespace jade::response {

/// Maximum number of lookups in one call on a GPU, where they are a kernel argument.
constexpr int kMostLookups = 8;
/// Maximum number of weights on the CPU for an image on a GPU: these are kernel arguments too.
constexpr int kFewWeights = 40;

/// An image to look up. Tensors are contiguous and of one floating type.
struct Lookup {
  at::Tensor image;    ///< [K, P...]
  at::Tensor weights;  ///< [K] of the sum over the first dimension; undefined: element by element
};

/// Images to look up in one table on their device.
struct Lookups {
  std::vector<Lookup> images;
  at::Tensor table;  ///< [kKnots]
};

/// Gradients that lookup_backward() computes.
struct LookupWanted {
  std::vector<bool> images;
  bool table = false;
};

struct LookupGradients {
  std::vector<at::Tensor> images;  ///< undefined unless requested and the result has a gradient
  at::Tensor table;                ///< sum over all images
};

namespace cpu {  // float or double
std::vector<at::Tensor> lookup(const Lookups& args);
/// @param gradients  of the results, contiguous; undefined: none. At least one is defined
LookupGradients lookup_backward(const Lookups& args, const std::vector<at::Tensor>& gradients,
                                const LookupWanted& wanted);
}  // namespace cpu

namespace cuda {  // float; one launch for all images
std::vector<at::Tensor> lookup(const Lookups& args);
LookupGradients lookup_backward(const Lookups& args, const std::vector<at::Tensor>& gradients,
                                const LookupWanted& wanted);
}  // namespace cuda

}  // namespace jade::response
