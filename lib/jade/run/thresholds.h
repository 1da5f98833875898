// SPDX-License-Identifier: Apache-2.0
// Measures contrast thresholds that are set to auto.
#pragma once

#include <string>

#include "jade/data/exposure.h"
#include "jade/data/threshold_estimate.h"
#include "jade/restore/restoration_cache.h"
#include "jade/train/options.h"

namespace jade::run {

/// data::estimate_thresholds() of the training exposures, cached with the restorations. Events of
/// one colour channel per pixel are compared with that channel. Thresholds are rounded to 1e-4.
/// @param fingerprint  data_fingerprint() of the data set
/// @param log_offset   ε of the sensor's log(I + ε), in units of intensity
/// @throws Interrupted.
data::ThresholdEstimate measure_thresholds(const data::Dataset& dataset,
                                           const std::string& fingerprint, double log_offset,
                                           const restore::RestorationCacheOptions& cache);

/// measure_thresholds() without a progress bar, for another thread.
data::ThresholdEstimate measure_quietly(const data::Dataset& dataset,
                                        const std::string& fingerprint, double log_offset,
                                        const restore::RestorationCacheOptions& cache);

/// One line that names the flip of an estimate and its cure; empty if it has none.
std::string flip_warning(const data::Dataset& dataset, const data::ThresholdEstimate& estimate);

/// Replaces events.threshold_positive auto by the measured thresholds, or by 0.25 with a warning.
/// Thresholds that are numbers do not change, including a negative one; a warning names both pairs
/// if they differ by more than 30 % from the measured ones. Warns of flipped events too
/// (flip_warning).
void settle_thresholds(const data::Dataset& dataset, const data::ThresholdEstimate& found,
                       train::RunOptions& options);

}  // namespace jade::run
