// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <torch/types.h>

#include "jade/run/deblurrer.h"

namespace jade::run {

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

}  // namespace jade::run
