// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/data/exposure.h"

namespace jade::data {

/// A sharp image of the scene at the middle of an exposure, for scoring.
struct Truth {
  std::string name;
  torch::Tensor image;      ///< [3,H,W]
  torch::Tensor mask = {};  ///< as Exposure::mask, of the true image and of its exposure combined
};

/// The true images of exposure `index`: the data set's sharp/<name>.* if there is one (simulated
/// sets), and every sharp test view taken at its mid-exposure.
/// @throws DataError for a true image of another size.
std::vector<Truth> truths_of(const Dataset& dataset, size_t index);

}  // namespace jade::data
