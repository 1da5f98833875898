// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/recording/recording.h"

namespace jade::import {

/// Masks that lie with the frames of a recording (alpha, masks/, mask.png), as data::read_masks
/// gives them: one per frame, [1,H,W] bool or undefined. Empty where no masks can lie there.
/// @param warnings  gets a line for frames without a mask where others have one
/// @throws DataError naming the mask that is unreadable, black or of another size than its frame.
std::vector<torch::Tensor> masks_of(const recording::Recording& recording,
                                    std::vector<std::string>& warnings);

}  // namespace jade::import
