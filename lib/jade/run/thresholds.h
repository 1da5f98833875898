// SPDX-License-Identifier: Apache-2.0
// The contrast thresholds of a program that reads a data set: measured where they are auto.
#pragma once

#include <string>

#include "jade/data/exposure.h"
#include "jade/data/threshold_estimate.h"
#include "jade/restore/restoration_cache.h"
#include "jade/train/options.h"

namespace jade::run {

/// data::estimate_thresholds() of the training exposures, through the cache of restorations: the
/// same data are measured once. Events that follow one colour channel per pixel are compared with
/// that channel. Thresholds are rounded to 1e-4.
/// @param fingerprint  data_fingerprint() of the data set
/// @param log_offset   ε of the sensor's log(I + ε), in units of intensity
/// @throws Interrupted.
data::ThresholdEstimate measure_thresholds(const data::Dataset& dataset,
                                           const std::string& fingerprint, double log_offset,
                                           const restore::RestorationCacheOptions& cache);

/// Puts numbers in place of events.threshold_positive auto: what measure_thresholds() finds, else
/// 0.25 with a warning. A negative threshold that is a number stays. Thresholds that are numbers
/// stay too; one warning names both pairs where they differ by more than 30 % from what is
/// measured.
void settle_thresholds(const data::Dataset& dataset, const std::string& fingerprint,
                       double log_offset, train::RunOptions& options);

}  // namespace jade::run
