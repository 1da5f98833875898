// SPDX-License-Identifier: Apache-2.0
// Linear interpolation in a table of ρ, apart from autograd; its arithmetic is in lookup_math.h.
// Not for use outside this room.
#pragma once

#include <ATen/core/Tensor.h>
#include <vector>

#include "jade/response/lookup_math.h"

namespace jade::response {

/// Most lookups in one call on a GPU, where they travel as the argument of a launch.
constexpr int kMostLookups = 8;
/// The most weights on the CPU that an image on a GPU may have: these travel likewise.
constexpr int kFewWeights = 40;

/// An image to be looked up. Tensors are contiguous and of one floating type.
struct Lookup {
  at::Tensor image;    ///< [K, P...]
  at::Tensor weights;  ///< [K] of the sum over the first dimension; undefined: element by element
};

/// Images that are looked up in one table on their device.
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
  std::vector<at::Tensor> images;  ///< undefined unless wanted and of a gradient
  at::Tensor table;                ///< of all images together
};

namespace cpu {  // float or double
std::vector<at::Tensor> lookup(const Lookups& args);
/// @param gradients  of the results, contiguous; undefined: none. At least one is there
LookupGradients lookup_backward(const Lookups& args, const std::vector<at::Tensor>& gradients,
                                const LookupWanted& wanted);
}  // namespace cpu

namespace cuda {  // float; one launch for all images
std::vector<at::Tensor> lookup(const Lookups& args);
LookupGradients lookup_backward(const Lookups& args, const std::vector<at::Tensor>& gradients,
                                const LookupWanted& wanted);
}  // namespace cuda

}  // namespace jade::response
