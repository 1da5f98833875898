// SPDX-License-Identifier: Apache-2.0
// Restores, writes and scores every frame of a data set without a scene.
#pragma once

#include <cstdint>
#include <filesystem>
#include <torch/types.h>
#include <vector>

#include "jade/eval/comparison.h"
#include "jade/run/deblurrer.h"

namespace jade::run {

/// Optional files beside NAME.png and the side pictures.
struct DeblurPictures {
  bool poses = false;              ///< NAME_<k>.png for the moments of exposure.samples
  bool npy = false;                ///< unclamped float32 [3,H,W] beside each picture
  std::vector<double> times = {};  ///< NAME_t<u>.png at these moments
};

struct Deblurred {
  std::vector<eval::ComparedView> views;  ///< one per exposure with a true image
  size_t written = 0;                     ///< exposures
  size_t without_truth = 0;  ///< exposures skipped because the method needs their true image
};

/// Restores every exposure, training or held out, into the existing folder `output`. Shows
/// progress. Poses are restored by a restorer of any moment; with one of the middle only, and for a
/// method that needs the truth, the middle is transformed to them by the ratio from the events.
/// @throws DataError, ConfigError, CheckpointError, NumericError of the restorer, the run, the true
///   images and the pictures.
Deblurred deblur(const data::Dataset& dataset, const DeblurOptions& options,
                 const restore::Method& method, const std::filesystem::path& output,
                 const DeblurPictures& pictures, torch::Device device);

}  // namespace jade::run
