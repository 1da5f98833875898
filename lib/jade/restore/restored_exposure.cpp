// SPDX-License-Identifier: Apache-2.0
#include "jade/restore/restored_exposure.h"

#include <torch/types.h>

#include "jade/core/error.h"

namespace jade::restore {

RestoredExposure restore_exposure(const data::Exposure& exposure,
                                  const events::EventOptions& events, ViewRestorer& restorer,
                                  double log_offset) {
  const torch::Device device = restorer.device();
  RestoredExposure restored;
  restored.maps =
      events::map_exposure(exposure.events, {exposure.t_start_us, exposure.t_end_us}, events.bins,
                           {exposure.camera.height, exposure.camera.width});
  restored.blurry = exposure.blurry.to(device).contiguous();
  const torch::Tensor windows =
      events::edi_windows(restored.maps.windows, events.thresholds()).to(device);
  restored.kernel = imaging::edi_kernel(windows, events.edi_index);

  // Part of the cache's keys.
  std::string settings = concat("index ", word_of(events.edi_index));
  if (log_offset != 0) settings += concat(" offset ", log_offset);
  restored.restorations.edi = restorer.edi(restored.blurry, windows, settings, [&] {
    return imaging::edi_mid(restored.blurry + log_offset, restored.kernel) - log_offset;
  });
  if (restorer.has_network()) {
    restored.restorations.efnet = restorer.efnet(restored.blurry, restored.maps.voxel.values);
  }
  return restored;
}

}  // namespace jade::restore
