// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/splat/render.h"
#include "jade/train/bank.h"
#include "jade/train/state.h"

namespace jade::run {

/// Returns the current Gaussians, without gradient.
using GaussianSource = std::function<splat::Gaussians()>;

/// A picture of one of the data set's cameras, computed on request.
struct ViewPicture {
  std::string name;
  std::function<torch::Tensor()> make;  ///< [3,H,W] or [1,H,W] on any device
  bool judged = false;                  ///< a restoration, which is scored against an available
                                        ///< true image
  bool fixed = false;                   ///< no step changes it
};

/// The sharp test view at an exposure's middle, or undefined.
torch::Tensor truth_of(const data::Dataset& dataset, int64_t exposure);

/// Mask of that view combined with the exposure's; undefined: all pixels count.
torch::Tensor truth_mask_of(const data::Dataset& dataset, int64_t exposure);

/// Pictures of a training view: blurry, EDI, EFNet, α and fused if available, event density, render
/// and, if a test view provides it, truth. The arguments must outlive the pictures.
std::vector<ViewPicture> training_pictures(const data::Dataset& dataset,
                                           const train::ViewBank& bank, int64_t index,
                                           train::TrainState& state,
                                           const splat::RenderOptions& draw);

/// Pictures of an exposure without training data: blurry, the `known` ones, render and, if a test
/// view provides it, truth.
std::vector<ViewPicture> exposure_pictures(const data::Dataset& dataset, int64_t index,
                                           std::vector<ViewPicture> known,
                                           const GaussianSource& gaussians,
                                           const splat::RenderOptions& draw);

/// Pictures of a test view: render, and truth if it has an image.
std::vector<ViewPicture> test_pictures(const data::SharpView& view, const GaussianSource& gaussians,
                                       const splat::RenderOptions& draw);

}  // namespace jade::run
