// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <torch/types.h>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/eval/report.h"
#include "jade/gaussians/ply.h"
#include "jade/splat/render.h"
#include "jade/train/options.h"

namespace jade::run {

/// One camera, clamped to [0,1], on the Gaussians' device, without gradient.
/// @param options  render_options() of the run
torch::Tensor render_view(const splat::Gaussians& gaussians, const geometry::Pose& pose,
                          const geometry::Intrinsics& camera, const splat::RenderOptions& options);

/// How many times as bright the image is to be to look most like the truth, in squared error.
double fitted_gain(const torch::Tensor& image, const torch::Tensor& truth);

/// `image` times its fitted_gain() over the pixels that count, clamped to [0,1].
/// @param mask  as data::SharpView::mask
torch::Tensor as_bright_as(const torch::Tensor& truth, const torch::Tensor& image,
                           const torch::Tensor& mask);

/// Scores renders of the sharp views, with LPIPS where `lpips` has its networks. They are made as
/// bright as the view's gain says, or as its image is.
/// @param fit_gain  for a scene that has learned the gains of its frames: those of test views are
///   fitted, and stand in the scores
eval::Evaluation evaluate_views(const splat::Gaussians& gaussians,
                                const std::vector<data::SharpView>& views, const eval::Lpips& lpips,
                                const splat::RenderOptions& options, bool fit_gain = false);

/// Scores renders that are blurred along the paths of exposures that training has not seen: their
/// mean over the moments of `exposure` against the blurry frame, as bright as evaluate_views()
/// says.
std::vector<eval::ReblurScore> evaluate_held_out(const splat::Gaussians& gaussians,
                                                 const std::vector<data::Exposure>& held_out,
                                                 const geometry::ExposureOptions& exposure,
                                                 const splat::RenderOptions& options,
                                                 bool fit_gain = false);

/// Both, over all that a data set has to judge by.
eval::Evaluation evaluate_dataset(const splat::Gaussians& gaussians, const data::Dataset& dataset,
                                  const eval::Lpips& lpips, const train::RunOptions& options);

/// Options in config.yaml of a run directory; keys newer than the run take their printed values.
/// @throws DataError where there is none, ConfigError naming the path.
train::RunOptions written_options(const std::filesystem::path& run);

/// written_options() with `device` auto: the run may come from another machine.
/// @throws as written_options.
train::RunOptions load_run_options(const std::filesystem::path& run);

/// The data set of `options`, with the learned poses where the run has ended with such: they belong
/// to its scene, whatever poses.optimize says by now. Before the run's end those of the newest
/// checkpoint, and the test views as they lie between them, not fitted. Its warnings go to the log.
/// @param options  those of the run, or with changes
/// @throws DataError naming the path.
data::Dataset load_run_dataset(const std::filesystem::path& run, const train::RunOptions& options);

/// The Gaussians of a run with their origin, on the CPU: those of its end, before it those of the
/// newest whole checkpoint.
/// @throws DataError where there are none, CheckpointError naming the path.
gaussians::GaussianFile newest_scene(const std::filesystem::path& run);

/// A run directory as other programs use it: its data and its newest Gaussians.
struct FinishedRun {
  data::Dataset dataset;
  splat::Gaussians gaussians;  ///< on the CPU
};

/// Its load_run_dataset() and its newest_scene().
/// @param options  those of the run, or with changes
/// @throws DataError, ConfigError or CheckpointError naming the path.
FinishedRun open_run(const std::filesystem::path& run, const train::RunOptions& options);

}  // namespace jade::run
