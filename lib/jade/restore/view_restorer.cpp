// SPDX-License-Identifier: Apache-2.0
#include "jade/restore/view_restorer.h"

#include <torch/types.h>

#include "jade/core/check.h"
#include "jade/core/version.h"
#include "jade/restore/restorations.h"

namespace jade::restore {

ViewRestorer::ViewRestorer(const RestorationCacheOptions& cache, std::optional<EfnetOptions> efnet,
                           torch::Device device, bool monochrome)
    : cache_(cache), options_(std::move(efnet)), device_(device), monochrome_(monochrome) {
  if (options_) file_sha256_ = checked_file_sha256(*options_);
}

ViewRestorer::~ViewRestorer() { cache_.prune(); }

torch::Tensor ViewRestorer::edi(const torch::Tensor& blurry, const torch::Tensor& windows,
                                const std::string& settings,
                                const std::function<torch::Tensor()>& compute) {
  const std::string recipe =
      concat("edi 1; ", settings, "; torch ", torch_version(), "; ", device_.type());
  return cache_.get(restoration_key(recipe, {blurry, windows}), blurry.sizes(), compute)
      .to(device_);
}

torch::Tensor ViewRestorer::efnet(const torch::Tensor& blurry, const torch::Tensor& voxel) {
  JADE_CHECK(options_.has_value(), "expected a restorer, found none");
  // Devices round differently, and a run must not depend on what another device left behind.
  const std::string recipe = concat("efnet 1; ", file_sha256_, "; torch ", torch_version(), "; ",
                                    device_.type(), monochrome_ ? "; without tint" : "");
  const std::string key = restoration_key(recipe, {blurry, voxel});
  if (const auto kept = cache_.find(key, blurry.sizes())) return kept->to(device_);
  torch::Tensor restored = network().restore(blurry.to(device_), voxel);
  if (monochrome_) restored = without_tint(restored);
  const bool as_asked = network().device().type() == device_.type() && network().tile() == 0;
  if (as_asked) cache_.keep(key, restored);
  return restored;
}

Restorer& ViewRestorer::network() {
  JADE_CHECK(options_.has_value(), "expected a restorer, found none");
  if (!network_) network_.emplace(*options_, device_);
  return *network_;
}

}  // namespace jade::restore
