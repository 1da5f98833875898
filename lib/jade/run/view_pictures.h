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

/// The Gaussians of now, without gradient.
using GaussianSource = std::function<splat::Gaussians()>;

/// A picture that belongs to a camera of the data set, made when it is asked for.
struct ViewPicture {
  std::string name;
  std::function<torch::Tensor()> make;  ///< [3,H,W] or [1,H,W] on any device
  bool judged = false;                  ///< a truth at hand judges it: it is a restoration
};

/// The sharp test view taken at an exposure's middle, or undefined.
torch::Tensor truth_of(const data::Dataset& dataset, int64_t exposure);

/// Which of its pixels count, of the view's mask and of the exposure's; undefined: all.
torch::Tensor truth_mask_of(const data::Dataset& dataset, int64_t exposure);

/// Pictures of a training view: blurry, EDI, EFNet, α and fused where available, event density,
/// render and, where a test view provides it, truth. The arguments must outlive the pictures.
std::vector<ViewPicture> training_pictures(const data::Dataset& dataset,
                                           const train::ViewBank& bank, int64_t index,
                                           train::TrainState& state,
                                           const splat::RenderOptions& draw);

/// Pictures of an exposure without training data: blurry, the `known` ones, render and, where a
/// test view provides it, truth.
std::vector<ViewPicture> exposure_pictures(const data::Dataset& dataset, int64_t index,
                                           std::vector<ViewPicture> known,
                                           const GaussianSource& gaussians,
                                           const splat::RenderOptions& draw);

/// Pictures of a test view: render, and truth where it has an image.
std::vector<ViewPicture> test_pictures(const data::SharpView& view, const GaussianSource& gaussians,
                                       const splat::RenderOptions& draw);

}  // namespace jade::run
