// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <torch/types.h>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/events/exposure_maps.h"
#include "jade/events/thresholds.h"
#include "jade/geometry/quadrature.h"
#include "jade/imaging/edi.h"
#include "jade/restore/restorations.h"
#include "jade/restore/view_restorer.h"

namespace jade::restore {

/// Options of an exposure's restoration.
struct RestoreOptions {
  events::EventOptions events;         ///< how events are summed and what they stand for
  geometry::ExposureOptions exposure;  ///< which moments the sharp images are of
  /// ε of a sensor that follows log(I + ε). It sees B + ε as the mean of I_k + ε, so the offset is
  /// added before EDI and taken off after.
  double log_offset = 0;
  /// Asks for RestoredExposure::taught_gain, with thresholds so many times as large; 1: it is gain.
  double taught_contrast = 1;
  /// Asks for RestoredExposure::efnet_at, at these moments: 0 the start and 1 the end.
  std::vector<double> times = {};
  /// Take all of these moments from the cache, or restore only the middle.
  bool only_kept_times = false;
};

/// How many moments the EDI integral of these options has.
int64_t integral_samples(const RestoreOptions& options);

/// One exposure restored at its middle, and what its events say.
struct RestoredExposure {
  events::ExposureMaps maps;  ///< on the CPU; their windows are those of the EDI integral
  // On the restorer's device:
  torch::Tensor blurry;       ///< [3,H,W]
  imaging::EdiKernel kernel;  ///< latent images over the blurry frame, at the integral's moments
  torch::Tensor gain;         ///< [K,H,W] the same at those of geometry::quadrature()
  torch::Tensor taught_gain;  ///< [K,H,W] `gain` of another contrast, for what teaches a scene
  Restorations restorations;  ///< I_edi; F where the restorer has a network, else undefined
  /// [M,3,H,W] F(B, V, t) at RestoreOptions::times, in their order; undefined without a network and
  /// without times. All moments of an exposure of no length are one image, repeated without memory.
  torch::Tensor efnet_at;
};

/// The events of an exposure, summed as its restoration needs them; on the CPU.
struct ExposureSums {
  events::ExposureMaps maps;  ///< as RestoredExposure's
  torch::Tensor network;      ///< what the network takes; undefined without one
};

/// Safe on several threads at once, beside restore_exposure().
/// @param recording  all events of the data set: events.ramp_ms reaches beyond the exposure.
/// @param network    whose input to sum, or null
ExposureSums sum_events(const data::Exposure& exposure, const events::EventStream& recording,
                        const RestoreOptions& options, const RestorerMetadata* network);

/// Bytes of memory that sum_events() takes per pixel of the image at its peak, about.
int64_t sum_bytes_per_pixel(const RestoreOptions& options, const RestorerMetadata* network);

/// Restores an exposure both ways, through the restorer's cache. Where the middle is among the
/// times, F is restored at the times alone.
/// @param sums  sum_events() with these options and the restorer's network
/// @throws NumericError, DeviceError, DataError from the network.
RestoredExposure restore_exposure(const data::Exposure& exposure, ExposureSums sums,
                                  const RestoreOptions& options, ViewRestorer& restorer);
/// restore_exposure() that calls sum_events() itself.
RestoredExposure restore_exposure(const data::Exposure& exposure,
                                  const events::EventStream& recording,
                                  const RestoreOptions& options, ViewRestorer& restorer);

}  // namespace jade::restore
