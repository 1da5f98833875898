// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

#include "jade/data/exposure.h"
#include "jade/events/exposure_maps.h"
#include "jade/events/thresholds.h"
#include "jade/imaging/edi.h"
#include "jade/restore/restorations.h"
#include "jade/restore/view_restorer.h"

namespace jade::restore {

/// One exposure restored at its middle, and what its events say.
struct RestoredExposure {
  events::ExposureMaps maps;  ///< on the CPU
  // On the restorer's device:
  torch::Tensor blurry;       ///< [3,H,W]
  imaging::EdiKernel kernel;  ///< latent images over the blurry frame
  Restorations restorations;  ///< I_edi; F where the restorer has a network, else undefined
};

/// Sums the events of an exposure and restores it both ways, through the restorer's cache.
/// @param events      how events are summed and what they stand for.
/// @param log_offset  ε of a sensor that follows log(I + ε). It sees B + ε as the mean of I_k + ε,
///   so the offset is added before EDI and taken off after.
/// @throws NumericError, DeviceError, DataError from the network.
RestoredExposure restore_exposure(const data::Exposure& exposure,
                                  const events::EventOptions& events, ViewRestorer& restorer,
                                  double log_offset = 0);

}  // namespace jade::restore
