// SPDX-License-Identifier: Apache-2.0
// The film of an exposure: its blurry frame, then its sharp moments.
#pragma once

#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/data/cameras.h"
#include "jade/data/exposure.h"
#include "jade/geometry/quadrature.h"

namespace jade::apps {

/// Frames of the film, in order.
struct Unblurring {
  std::string name;                        ///< of the exposure
  torch::Tensor blurry;                    ///< [3,H,W] in [0,1], CPU
  std::vector<data::NamedCamera> moments;  ///< NAME_0 …, zero-padded to the digits of the last one
};

/// The exposure of that name, training or held out.
/// @throws ConfigError that begins with `flag` and names those with a similar name.
const data::Exposure& exposure_named(const data::Dataset& dataset, const std::string& name,
                                     const std::string& flag);

/// The exposure at the moments that training renders.
/// @throws ConfigError for a sharp image, which has no duration.
Unblurring unblurring_of(const data::Exposure& exposure, const geometry::ExposureOptions& options);

}  // namespace jade::apps
