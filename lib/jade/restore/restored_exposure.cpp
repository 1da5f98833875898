// SPDX-License-Identifier: Apache-2.0
#include "jade/restore/restored_exposure.h"

#include <algorithm>
#include <torch/types.h>
#include <utility>

#include "jade/events/ramps.h"
#include "jade/imaging/edi.h"

namespace jade::restore {
namespace {

using geometry::QuadratureRule;

int64_t reach_of(const events::EventOptions& options) {
  return static_cast<int64_t>(options.ramp_ms * 1000);
}

/// The moments of the EDI integral and their weights.
struct Integral {
  int64_t samples;
  QuadratureRule rule;
};

Integral integral_of(const RestoreOptions& options) {
  if (options.events.edi_samples > 0) {
    return {options.events.edi_samples, QuadratureRule::kTrapezoid};
  }
  return {options.exposure.samples, options.exposure.quadrature};
}

torch::Tensor gain_at(const torch::Tensor& windows, const RestoreOptions& options,
                      const std::vector<double>& times, double contrast) {
  const torch::Tensor u = torch::tensor(times, torch::kFloat64).to(windows.device());
  return imaging::edi_gain(windows, integral_of(options).rule, u, contrast);
}

/// @param lasts  false: the exposure has zero length, so all its moments equal the middle
void restore_learned(const torch::Tensor& blurry, const ExposureSums& sums, bool lasts,
                     const RestoreOptions& options, ViewRestorer& restorer,
                     RestoredExposure& restored) {
  const torch::Tensor& events = sums.network;
  const std::vector<double>& times = options.times;
  torch::Tensor& middle = restored.restorations.efnet;
  if (times.empty() || !lasts) {
    middle = restorer.efnet(blurry, events);
    const auto count = static_cast<int64_t>(times.size());
    if (count > 0) restored.efnet_at = middle.unsqueeze(0).expand({count, -1, -1, -1});
    return;
  }
  KeptEfnet kept = sums.kept;
  if (options.only_kept_times) kept = restorer.kept_efnet(blurry, events, times);
  if (kept.images.defined()) {
    restored.efnet_at = kept.images.to(restorer.device());
  } else if (!options.only_kept_times) {
    restored.efnet_at = restorer.efnet(blurry, events, times, kept.key);
  }
  const auto found = std::find(times.begin(), times.end(), 0.5);
  const bool has_middle = restored.efnet_at.defined() && found != times.end();
  // A copy, so that the memory of the others can be freed.
  middle = has_middle ? restored.efnet_at[found - times.begin()].to(
                            torch::kFloat32, /*non_blocking=*/false, /*copy=*/true)
                      : restorer.efnet(blurry, events);
}

}  // namespace

int64_t integral_samples(const RestoreOptions& options) { return integral_of(options).samples; }

ExposureSums sum_events(const data::Exposure& exposure, const events::EventStream& recording,
                        const RestoreOptions& options, const RestorerMetadata* network) {
  const events::TimeWindow span{exposure.t_start_us, exposure.t_end_us};
  const events::ImageSize size{exposure.camera.height, exposure.camera.width};
  ExposureSums sums;
  const bool ramped = reach_of(options.events) > 0;  // ramps count the windows differently
  const bool any_time = network != nullptr && network->any_time;
  sums.maps = events::map_exposure(exposure.events, span, events::kVoxelBins, size,
                                   ramped ? 1 : integral_samples(options) - 1,
                                   any_time ? network->windows : 0);
  if (ramped) {
    sums.maps.windows = events::ramped_windows(recording, span, integral_samples(options) - 1,
                                               reach_of(options.events), size);
  }
  sums.windows = events::edi_windows(std::move(sums.maps.windows), options.events.thresholds());
  if (any_time) {
    sums.network = std::move(sums.maps.signed_windows);
  } else if (network != nullptr) {
    sums.network = sums.maps.voxel.values;
  }
  return sums;
}

void look_up(const data::Exposure& exposure, const RestoreOptions& options,
             const ViewRestorer& restorer, ExposureSums& sums) {
  if (!restorer.has_network() || options.times.empty() || exposure.duration_us() == 0) return;
  sums.kept = restorer.kept_efnet(exposure.blurry, sums.network, options.times);
}

void upload(torch::Device device, ExposureSums& sums) {
  try {
    sums.windows = sums.windows.to(device);
    if (sums.network.defined()) sums.network = sums.network.to(device);
  } catch (const c10::OutOfMemoryError&) {
    // restore_exposure() copies the rest when the network has freed its memory.
  }
}

int64_t sum_bytes_per_pixel(const RestoreOptions& options, const RestorerMetadata* network) {
  // Windows of both signs and together, bins twice, the network's windows, and some further maps.
  const int64_t maps = 3 * (integral_samples(options) - 1) + 2 * events::kVoxelBins +
                       (network != nullptr ? network->windows : 0) + 8;
  // Six sorted events per pixel, as in fast motion.
  constexpr int64_t kEvents = 6 * 20;
  return maps * int64_t{sizeof(float)} + kEvents;
}

RestoredExposure restore_exposure(const data::Exposure& exposure,
                                  const events::EventStream& recording,
                                  const RestoreOptions& options, ViewRestorer& restorer) {
  return restore_exposure(exposure,
                          sum_events(exposure, recording, options,
                                     restorer.has_network() ? &restorer.metadata() : nullptr),
                          options, restorer);
}

RestoredExposure restore_exposure(const data::Exposure& exposure, ExposureSums sums,
                                  const RestoreOptions& options, ViewRestorer& restorer) {
  const torch::Device device = restorer.device();
  RestoredExposure restored;
  restored.maps = std::move(sums.maps);
  const torch::Tensor blurry = exposure.blurry.to(device).contiguous();
  // Run it before EDI, so that EDI's 64 maps and the network's memory are not needed at once.
  if (restorer.has_network()) {
    restore_learned(blurry, sums, exposure.duration_us() > 0, options, restorer, restored);
  }
  restored.windows = sums.windows.to(device);
  const std::vector<double> samples =
      geometry::quadrature(options.exposure.quadrature, options.exposure.samples).u;
  restored.gain = gain_at(restored.windows, options, samples, 1);
  restored.taught_gain = options.taught_contrast == 1
                             ? restored.gain
                             : gain_at(restored.windows, options, samples, options.taught_contrast);
  const torch::Tensor middle = restored.gain.narrow(0, options.exposure.samples / 2, 1);
  restored.restorations.edi = (blurry + options.log_offset) * middle - options.log_offset;
  return restored;
}

torch::Tensor gain_at(const RestoredExposure& restored, const RestoreOptions& options,
                      const std::vector<double>& times) {
  return gain_at(restored.windows, options, times, 1);
}

}  // namespace jade::restore
