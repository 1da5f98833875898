// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/restore/methods.h"
#include "jade/restore/view_restorer.h"
#include "jade/router/allocation.h"
#include "jade/train/options.h"

namespace jade::run {

struct DeblurOptions {
  train::RunOptions settings;  ///< uses dataset, events, exposure, efnet, cache and device
  /// ε of a sensor that measures log(I + ε), in units of intensity; 0 for log(I).
  double log_offset = 0;
  std::filesystem::path run;  ///< of the router; empty: none
  /// If the cache has F at these moments, takes the middle from them.
  std::vector<double> kept_times = {};
};

/// One exposure restored at its middle, and at other moments.
struct Restored {
  restore::Candidates candidates;  ///< on the CPU
  torch::Tensor gain;              ///< [K,1,H,W], latent image of each moment relative to the frame
  torch::Tensor events;            ///< [2,H,W] positive and negative events during the exposure
  /// Candidates at the requested moments, in their order; only the middle has a true image.
  std::vector<restore::Candidates> at;
};

/// Restores exposures of a data set, through the cache.
class Deblurrer {
 public:
  /// @throws DataError, ConfigError or CheckpointError for the restorer and the run.
  Deblurrer(const DeblurOptions& options, const restore::Method& method,
            const data::Dataset& dataset, torch::Device device);

  /// @param index  among the training views, used by per_view_map only
  /// @param times  additional moments to restore, 0 the start and 1 the end of the exposure
  /// @throws DataError if the restorer supports the middle only.
  Restored restore(const data::Exposure& exposure, int64_t index,
                   const std::vector<double>& times = {});

  /// Whether there is a network, and it restores any moment.
  bool has_any_time_network() const;

  /// Transforms the image at mid-exposure to all poses, by the ratio from the events.
  /// @return [K,3,H,W]
  torch::Tensor at_all_poses(const torch::Tensor& mid, const Restored& restored) const;

 private:
  DeblurOptions options_;
  events::EventStream events_;  ///< of the recording
  restore::ViewRestorer restorer_;
  std::shared_ptr<router::Allocation> allocation_;  ///< nullptr unless a router is used
};

}  // namespace jade::run
