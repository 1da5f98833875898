// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <torch/types.h>

#include "jade/data/exposure.h"

namespace jade::data {

/// A sharp image of the scene at the middle of an exposure, for scoring.
struct Truth {
  std::string name;
  torch::Tensor image;      ///< [3,H,W]
  torch::Tensor mask = {};  ///< as Exposure::mask, of the true image and of its exposure combined
};

/// The true image of an exposure, training or held out: the data set's sharp/<name>.* if there is
/// one (simulated sets), else the first sharp test view taken at its mid-exposure, else none.
/// @throws DataError for a true image of another size.
std::optional<Truth> truth_of(const Dataset& dataset, const Exposure& exposure);

}  // namespace jade::data
