// SPDX-License-Identifier: Apache-2.0
#include "methods.h"

#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/events/exposure_maps.h"
#include "jade/imaging/edi.h"

namespace jade::apps {
namespace {

/// EDI at all nine poses. A sensor that follows log(I + ε) sees B + ε as the mean of I_k + ε, so
/// the offset is added before and taken off after.
Restoration restore_edi(const data::Exposure& exposure, const MethodOptions& options) {
  constexpr int64_t kBins = 6;
  const events::ImageSize size{exposure.camera.height, exposure.camera.width};
  const events::ExposureMaps maps =
      events::map_exposure(exposure.events, {exposure.t_start_us, exposure.t_end_us}, kBins, size);
  const imaging::EdiKernel kernel =
      imaging::edi_kernel(events::edi_windows(maps.windows, options.thresholds));
  const torch::Tensor latents =
      imaging::edi_all(exposure.blurry + options.log_offset, kernel) - options.log_offset;
  return {latents, torch::stack({maps.windows.positive.sum(0), maps.windows.negative.sum(0)})};
}

/// Half EDI, half the frame itself: what a fixed weight gives that trusts both alike.
Restoration restore_mean(const data::Exposure& exposure, const MethodOptions& options) {
  Restoration restoration = restore_edi(exposure, options);
  restoration.latents = 0.5 * (restoration.latents.clamp(0, 1) + exposure.blurry);
  return restoration;
}

}  // namespace

const std::vector<Method>& methods() {
  static const std::vector<Method> all = {
      {"edi", "event double integral at the nine poses", restore_edi},
      {"mean",
       "mean of EDI and the other restoration, which is the frame itself as long as no "
       "network is given",
       restore_mean}};
  return all;
}

const Method& find_method(const std::string& name) {
  std::string known;
  for (const Method& method : methods()) {
    if (method.name == name) return method;
    known += (known.empty() ? "" : ", ") + method.name;
  }
  throw ConfigError(concat("--method: expected one of ", known, ", found '", name, "'"));
}

}  // namespace jade::apps
