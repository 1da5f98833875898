// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <torch/types.h>
#include <vector>

#include "deblurrer.h"
#include "jade/data/exposure.h"

namespace jade::apps {

/// Events as a picture: white without, red where brightness rose, blue where it fell, full colour
/// at the 99th percentile of the counts.
/// @param counts  [2,H,W], positive and negative.
/// @return [3,H,W]
torch::Tensor event_picture(const torch::Tensor& counts);

/// Writes OUTPUT/<what>/NAME.png: events and, where there are two restorations, edi, efnet,
/// difference (their mean absolute difference, four times), alpha (white: EDI), and with a truth
/// oracle (the better one at each pixel) and better (which that is; white: EDI).
void write_side_pictures(const std::filesystem::path& output, const std::string& name,
                         const Restored& restored);

/// A sharp image of the scene at the middle of an exposure, for scoring.
struct Truth {
  std::string name;
  torch::Tensor image;  ///< [3,H,W]
};

/// The truths of exposure `index`: the data set's sharp/<name>.* where there is one (simulated
/// sets), and every sharp test view taken at its mid-exposure.
/// @throws DataError for a truth of another size.
std::vector<Truth> truths_of(const data::Dataset& dataset, size_t index);

}  // namespace jade::apps
