// SPDX-License-Identifier: Apache-2.0
// Whether the points from which a scene starts fit its cameras.
#pragma once

#include "jade/data/exposure.h"
#include "jade/data/warnings.h"

namespace jade::data {

/// Warns of points that do not fit the cameras: behind them, in hardly any picture, all at one spot
/// of the pictures or much farther away than the cameras are apart, as in other axes, of another
/// scene or in another unit. Removes points that are in no picture, so that the scene starts
/// without them; depth bounds that derive from them are then those of the cameras.
void check_points(const Warnings& warnings, Dataset& data);

}  // namespace jade::data
