// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <torch/types.h>

#include "jade/run/deblurrer.h"

namespace jade::run {

/// Draws events as a picture: white without events, red where brightness increased, blue where it
/// decreased, full colour at the 99th percentile of the counts.
/// @param counts  [2,H,W], positive and negative.
/// @return [3,H,W]
torch::Tensor event_picture(const torch::Tensor& counts);

/// Writes OUTPUT/<what>/NAME.png: events and, with two restorations, edi, efnet, difference (four
/// times their mean absolute difference), alpha (white: EDI), and with a true image oracle (the
/// better one at each pixel) and better (which that is; white: EDI).
void write_side_pictures(const std::filesystem::path& output, const std::string& name,
                         const Restored& restored);

}  // namespace jade::run
