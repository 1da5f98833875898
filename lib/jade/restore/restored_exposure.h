// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <torch/types.h>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/events/exposure_maps.h"
#include "jade/events/thresholds.h"
#include "jade/geometry/quadrature.h"
#include "jade/restore/restorations.h"
#include "jade/restore/view_restorer.h"

namespace jade::restore {

/// Options of an exposure's restoration.
struct RestoreOptions {
  events::EventOptions events;         ///< how events are summed, and their thresholds
  geometry::ExposureOptions exposure;  ///< moments of the sharp images
  /// ε of a sensor with response log(I + ε). It sees B + ε as the mean of I_k + ε, so EDI adds the
  /// offset first and subtracts it afterwards.
  double log_offset = 0;
  /// Requests RestoredExposure::taught_gain, with thresholds scaled by this factor; 1: equal to
  /// gain.
  double taught_contrast = 1;
  /// Requests RestoredExposure::efnet_at, at these moments: 0 the start and 1 the end.
  std::vector<double> times = {};
  /// Uses the cache only if it has all of these moments; else restores only the middle.
  bool only_kept_times = false;
};

/// Number of moments of the EDI integral with these options.
int64_t integral_samples(const RestoreOptions& options);

/// One exposure restored at its middle, with its event maps.
struct RestoredExposure {
  events::ExposureMaps maps;  ///< on the CPU, without their windows
  // On the restorer's device:
  torch::Tensor windows;  ///< [S−1,H,W] events::edi_windows(), S integral_samples()
  torch::Tensor gain;     ///< [K,H,W] latent images relative to the blurry frame, at the moments
                          ///< of geometry::quadrature()
  torch::Tensor taught_gain;  ///< [K,H,W] `gain` with scaled thresholds, for the EDI loss
  Restorations restorations;  ///< I_edi; F if the restorer has a network, else undefined
  /// [M,3,H,W] F(B, V, t) at RestoreOptions::times, in their order; undefined without a network or
  /// without times. For an exposure of zero length all moments are views of one image.
  torch::Tensor efnet_at;
};

/// The events of an exposure, summed as its restoration needs them; on the CPU, or after upload()
/// on the device.
struct ExposureSums {
  events::ExposureMaps maps;  ///< as RestoredExposure's
  torch::Tensor windows;      ///< as RestoredExposure's
  torch::Tensor network;      ///< input of the network; undefined without one
  KeptEfnet kept;             ///< F at RestoreOptions::times, if look_up() found it in the cache
};

/// Thread-safe, also in parallel with restore_exposure().
/// @param recording  all events of the data set: events.ramp_ms extends beyond the exposure.
/// @param network    whose input to sum, or null
ExposureSums sum_events(const data::Exposure& exposure, const events::EventStream& recording,
                        const RestoreOptions& options, const RestorerMetadata* network);

/// Looks F at RestoreOptions::times up in the restorer's cache, for restore_exposure(). May be
/// called on any thread.
void look_up(const data::Exposure& exposure, const RestoreOptions& options,
             const ViewRestorer& restorer, ExposureSums& sums);

/// Copies windows and the network's input to the device, if they fit there. May be called on any
/// thread; waits for the copies.
void upload(torch::Device device, ExposureSums& sums);

/// Approximate peak bytes per pixel of the image that sum_events() needs.
int64_t sum_bytes_per_pixel(const RestoreOptions& options, const RestorerMetadata* network);

/// Latent images relative to the blurry frame at any moments, 0 the start and 1 the end.
/// @return [M,H,W], on the restorer's device
torch::Tensor gain_at(const RestoredExposure& restored, const RestoreOptions& options,
                      const std::vector<double>& times);

/// Restores an exposure by EDI and EFNet, through the restorer's cache. If the middle is among the
/// times, restores F only at the times.
/// @param sums  sum_events() with these options and the restorer's network; look_up() is optional
/// @throws NumericError, DeviceError, DataError from the network.
RestoredExposure restore_exposure(const data::Exposure& exposure, ExposureSums sums,
                                  const RestoreOptions& options, ViewRestorer& restorer);
/// restore_exposure() that calls sum_events() itself.
RestoredExposure restore_exposure(const data::Exposure& exposure,
                                  const events::EventStream& recording,
                                  const RestoreOptions& options, ViewRestorer& restorer);

}  // namespace jade::restore
