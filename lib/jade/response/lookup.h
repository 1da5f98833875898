// SPDX-License-Identifier: Apache-2.0
// Linear interpolation in a table of ρ, apart from autograd; its arithmetic is in lookup_math.h.
// Not for use outside this room.
#pragma once

#include <ATen/core/Tensor.h>

#include "jade/response/lookup_math.h"

namespace jade::response {

/// All tensors contiguous, of one floating type and device.
struct Lookup {
  at::Tensor image;    ///< [K, P...]
  at::Tensor table;    ///< [kKnots]
  at::Tensor weights;  ///< [K] of the sum over the first dimension; undefined: element by element
};

struct LookupGradient {
  at::Tensor image;  ///< undefined unless wanted
  at::Tensor table;
};

namespace cpu {  // float or double
at::Tensor lookup(const Lookup& args);
LookupGradient lookup_backward(const Lookup& args, const at::Tensor& gradient, bool wants_image,
                               bool wants_table);
}  // namespace cpu

namespace cuda {  // float
at::Tensor lookup(const Lookup& args);
LookupGradient lookup_backward(const Lookup& args, const at::Tensor& gradient, bool wants_image,
                               bool wants_table);
}  // namespace cuda

}  // namespace jade::response
