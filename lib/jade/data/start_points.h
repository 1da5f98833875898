// SPDX-License-Identifier: Apache-2.0
// Whether the points from which a scene starts fit its cameras.
#pragma once

#include <string>
#include <torch/types.h>

#include "jade/data/exposure.h"
#include "jade/data/warnings.h"

namespace jade::data {

/// Leaves out points, and their colours, that are not finite or over a million times as far from
/// the middle of all as most, with a warning: one would spoil sizes and depths of all.
/// @param points  [P,3] of a floating type
void drop_absurd_points(const std::string& where, const Warnings& warnings, torch::Tensor& points,
                        torch::Tensor& colors);

/// Warns of points that do not fit the cameras: behind them, in hardly any picture, all at one spot
/// of the pictures or much farther away than the cameras are apart, as in other axes, of another
/// scene or in another unit. Removes points that are in no picture, so that the scene starts
/// without them; depth bounds that derive from them are then those of the cameras.
void check_points(const Warnings& warnings, Dataset& data);

}  // namespace jade::data
