// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "jade/simulate/footage.h"
#include "jade/simulate/options.h"
#include "jade/simulate/sensor.h"

namespace jade::simulate {

/// The settings of each exposure of `timeline` by a camera that meters the middle third of the
/// frame before and brings its mean to image.auto_exposure: by exposures down to an eighth of their
/// length, by a gain up to eight. All are 1 where that is 0.
std::vector<ExposureSetting> exposure_settings(const SimulateOptions& options,
                                               const Footage& footage, const Timeline& timeline);

/// Shortens each exposure about its middle, so that test views stay where they are.
void shorten(const std::vector<ExposureSetting>& settings, Timeline& timeline);

}  // namespace jade::simulate
