// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <torch/types.h>
#include <vector>

namespace jade::import {

/// Whether something moved where a frame shows nothing: rows [begin, end) of frame i had events.
using SawChange = std::function<bool(size_t frame, int64_t begin, int64_t end)>;

/// Indices of frames without a whole picture among others: those of one gray level (black, white),
/// and those whose upper or lower rows, a twentieth or more, are of one gray level up to a sharp
/// edge although events saw a change there, as in a file that was cut off. A night sky or a
/// saturated one has no events and is no such fault; neither are rows that are blank in the usual
/// frame, of all or of the five around it (borders, a horizon that moves). Empty if half of the
/// frames or more are alike.
/// @param images  [3,H,W] each, all of one size
std::vector<size_t> bad_frames(const std::vector<torch::Tensor>& images,
                               const SawChange& saw_change);

}  // namespace jade::import
