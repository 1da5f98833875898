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

/// Renders one camera, clamped to [0,1], on the Gaussians' device, without gradient.
/// @param options  render_options() of the run
torch::Tensor render_view(const splat::Gaussians& gaussians, const geometry::Pose& pose,
                          const geometry::Intrinsics& camera, const splat::RenderOptions& options);

/// The factor by which to multiply the image to minimise its squared error to the truth.
double fitted_gain(const torch::Tensor& image, const torch::Tensor& truth);

/// `image` times its fitted_gain() over the pixels that count, clamped to [0,1].
/// @param mask  as data::SharpView::mask
torch::Tensor as_bright_as(const torch::Tensor& truth, const torch::Tensor& image,
                           const torch::Tensor& mask);

/// Scores renders of the sharp views, with LPIPS if `lpips` has its networks. Renders are
/// multiplied by the view's gain, or by a fitted one.
/// @param fit_gain  for a scene with learned gains: fits the gains of test views, and reports them
eval::Evaluation evaluate_views(const splat::Gaussians& gaussians,
                                const std::vector<data::SharpView>& views, const eval::Lpips& lpips,
                                const splat::RenderOptions& options, bool fit_gain = false);

/// Scores renders that are blurred along the paths of held-out exposures: their mean over the
/// moments of `exposure` against the blurry frame, with gains as in evaluate_views().
std::vector<eval::ReblurScore> evaluate_held_out(const splat::Gaussians& gaussians,
                                                 const std::vector<data::Exposure>& held_out,
                                                 const geometry::ExposureOptions& exposure,
                                                 const splat::RenderOptions& options,
                                                 bool fit_gain = false);

/// Both, for all test views and held-out exposures of a data set.
eval::Evaluation evaluate_dataset(const splat::Gaussians& gaussians, const data::Dataset& dataset,
                                  const eval::Lpips& lpips, const train::RunOptions& options);

/// Options in config.yaml of a run directory; keys newer than the run have their printed values.
/// @throws DataError if there is none, ConfigError naming the path.
train::RunOptions written_options(const std::filesystem::path& run);

/// written_options() with `device` auto: the run may come from another machine.
/// @throws as written_options.
train::RunOptions load_run_options(const std::filesystem::path& run);

/// The data set of `options`, with the run's learned poses if it ended with any, even if
/// poses.optimize has changed: they belong to its scene. Before the run's end uses those of the
/// newest checkpoint, with test views interpolated between them, not fitted. Logs its warnings.
/// @param options  those of the run, or with changes
/// @throws DataError naming the path.
data::Dataset load_run_dataset(const std::filesystem::path& run, const train::RunOptions& options);

/// The Gaussians of a run with their origin, on the CPU: the final ones, before the run's end those
/// of the newest undamaged checkpoint.
/// @throws DataError if there are none, CheckpointError naming the path.
gaussians::GaussianFile newest_scene(const std::filesystem::path& run);

/// A run directory's data and newest Gaussians, for other programs.
struct FinishedRun {
  data::Dataset dataset;
  splat::Gaussians gaussians;  ///< on the CPU
};

/// Loads load_run_dataset() and newest_scene().
/// @param options  those of the run, or with changes
/// @throws DataError, ConfigError or CheckpointError naming the path.
FinishedRun open_run(const std::filesystem::path& run, const train::RunOptions& options);

}  // namespace jade::run
