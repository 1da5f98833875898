// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <torch/types.h>
#include <vector>

namespace jade::import {

/// Indices of frames without a whole picture among others: those of one gray level (black, white),
/// and those whose upper or lower rows, a twentieth or more, are of one gray level up to a sharp
/// edge, as in a file that was cut off. Rows that are blank in the usual frame (borders), saturated
/// rows (a bright sky) and rows that fade into the picture (a dark place) are no such fault. Empty
/// if half of the frames or more are alike in this.
/// @param images  [3,H,W] each, all of one size
std::vector<size_t> bad_frames(const std::vector<torch::Tensor>& images);

}  // namespace jade::import
