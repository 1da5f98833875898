// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "jade/simulate/footage.h"
#include "jade/simulate/options.h"
#include "jade/simulate/sensor.h"

namespace jade::simulate {

/// The settings of each exposure of `timeline` for a camera with automatic exposure: it measures
/// the middle third of the previous frame and adjusts its mean to image.auto_exposure, by exposure
/// times down to an eighth and gains up to eight. All settings are 1 if image.auto_exposure is 0.
std::vector<ExposureSetting> exposure_settings(const SimulateOptions& options,
                                               const Footage& footage, const Timeline& timeline);

/// Shortens each exposure symmetrically about its middle, so that the times of test views do not
/// change.
void shorten(const std::vector<ExposureSetting>& settings, Timeline& timeline);

}  // namespace jade::simulate
