// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/recording/recording.h"

namespace jade::import {

/// Masks stored with the frames of a recording (alpha, masks/, mask.png), from data::read_masks:
/// one per frame, [1,H,W] bool or undefined. Empty if the format cannot have masks.
/// @param warnings receives a line for frames without a mask if others have one
/// @throws DataError naming the mask that is unreadable, black or of another size than its frame.
std::vector<torch::Tensor> masks_of(const recording::Recording& recording,
                                    std::vector<std::string>& warnings);

}  // namespace jade::import
