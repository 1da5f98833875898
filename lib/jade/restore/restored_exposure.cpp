// SPDX-License-Identifier: Apache-2.0
#include "jade/restore/restored_exposure.h"

#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/events/ramps.h"

namespace jade::restore {
namespace {

using geometry::QuadratureRule;

/// Where nothing else is said: fine enough for any drawn moment.
constexpr int64_t kFineSamples = 65;

/// The moments of the EDI integral and their weights.
struct Integral {
  int64_t samples;
  QuadratureRule rule;
};

Integral integral_of(const RestoreOptions& options) {
  const bool drawn = options.exposure.quadrature == QuadratureRule::kJittered;
  if (options.events.edi_samples > 0) {
    return {options.events.edi_samples, QuadratureRule::kTrapezoid};
  }
  if (drawn) return {kFineSamples, QuadratureRule::kTrapezoid};
  return {options.exposure.samples, options.exposure.quadrature};
}

torch::Tensor gain_at_samples(const imaging::EdiKernel& kernel,
                              const geometry::ExposureOptions& options) {
  const bool same =
      kernel.gain.size(0) == options.samples && options.quadrature != QuadratureRule::kJittered;
  if (same) return kernel.gain;
  const auto u = geometry::quadrature(options.quadrature, options.samples).u;
  return imaging::edi_gain(kernel.log_gain,
                           torch::tensor(u, torch::kFloat64).to(kernel.log_gain.device()));
}

}  // namespace

RestoredExposure restore_exposure(const data::Exposure& exposure,
                                  const events::EventStream& recording,
                                  const RestoreOptions& options, ViewRestorer& restorer) {
  const torch::Device device = restorer.device();
  const events::TimeWindow span{exposure.t_start_us, exposure.t_end_us};
  const events::ImageSize size{exposure.camera.height, exposure.camera.width};
  const Integral integral = integral_of(options);
  const auto reach_us = static_cast<int64_t>(options.events.ramp_ms * 1000);
  RestoredExposure restored;
  restored.maps =
      events::map_exposure(exposure.events, span, options.events.bins, size, integral.samples - 1);
  if (reach_us > 0) {
    restored.maps.windows =
        events::ramped_windows(recording, span, integral.samples - 1, reach_us, size);
  }
  restored.blurry = exposure.blurry.to(device).contiguous();
  const torch::Tensor windows =
      events::edi_windows(restored.maps.windows, options.events.thresholds()).to(device);
  restored.kernel = imaging::edi_kernel(windows, integral.rule, options.events.edi_index);
  restored.gain = gain_at_samples(restored.kernel, options.exposure);

  // Part of the cache's keys.
  std::string settings = concat("index ", word_of(options.events.edi_index));
  if (integral.rule != QuadratureRule::kEqual) settings += concat(" ", word_of(integral.rule));
  if (options.log_offset != 0) settings += concat(" offset ", options.log_offset);
  restored.restorations.edi = restorer.edi(restored.blurry, windows, settings, [&] {
    return imaging::edi_mid(restored.blurry + options.log_offset, restored.kernel) -
           options.log_offset;
  });
  if (restorer.has_network()) {
    restored.restorations.efnet = restorer.efnet(restored.blurry, restored.maps.voxel.values);
  }
  return restored;
}

}  // namespace jade::restore
