// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <ATen/core/Generator.h>
#include <cstdint>
#include <limits>
#include <torch/types.h>

#include "jade/core/fields.h"
#include "jade/gaussians/gaussian_model.h"
#include "jade/gaussians/optimizer.h"
#include "jade/splat/render.h"

namespace jade::gaussians {

/// Position of the Gaussians that strategy mcmc adds or relocates.
enum class McmcCopies { kStacked, kSpread };

constexpr auto words_of(McmcCopies) {
  return std::array{Word{"stacked", McmcCopies::kStacked,
                         "at the centre of the copied Gaussian, as published; both then have the "
                         "same gradient, and separate only after thousands of steps"},
                    Word{"spread", McmcCopies::kSpread,
                         "sampled from that Gaussian and 1.6 times smaller, like children of a "
                         "split; relocated ones copy Gaussians with large screen gradients"}};
}

/// 3DGS as Markov chain Monte Carlo (Kheradmand et al., NeurIPS 2024); members without a key have
/// its values.
struct McmcOptions {
  McmcCopies copies = McmcCopies::kSpread;
  double noise_lr = 5e5;  ///< exploration noise relative to the means' step size. No key
  /// Share of new Gaussians per densification in a run of 25,000 steps, which has 145; with fewer
  /// densifications each adds more. No key.
  double growth = 0.05;
};

/// Weights of the mean opacity and of the mean scale in the loss, as in 3DGS-MCMC.
constexpr double kMcmcOpacityRegularization = 0.01, kMcmcScaleRegularization = 0.01;

template <class V>
void describe(V& v, McmcOptions& o) {
  v.field("copies", o.copies, "where new and relocated Gaussians are put");
  v.fixed("noise_lr", o.noise_lr);
  v.fixed("growth", o.growth);
  v.fixed("opacity_regularization", kMcmcOpacityRegularization);
  v.fixed("scale_regularization", kMcmcScaleRegularization);
}

enum class DensifyStrategy { kAdc, kMcmc, kNone };

constexpr auto words_of(DensifyStrategy) {
  return std::array{Word{"adc", DensifyStrategy::kAdc, "clone, split and prune"},
                    Word{"mcmc", DensifyStrategy::kMcmc, "relocation and noise"},
                    Word{"none", DensifyStrategy::kNone, "fixed number"}};
}

/// Which poses of an exposure contribute to the screen gradients.
enum class CountedPoses { kAll, kFirst };

constexpr auto words_of(CountedPoses) {
  return std::array{Word{"all_poses", CountedPoses::kAll},
                    Word{"first_pose", CountedPoses::kFirst}};
}

/// Clone, split and prune as in 3DGS: Gaussians larger than kSplitScale of the extent are split and
/// smaller ones cloned; those with an opacity below kPruneOpacity are removed, and after the first
/// opacity reset also those larger than kPruneScale of the extent.
constexpr double kSplitScale = 0.01, kPruneOpacity = 0.005, kPruneScale = 0.1;

struct DensifyOptions {
  DensifyStrategy strategy = DensifyStrategy::kMcmc;
  CountedPoses statistics = CountedPoses::kAll;
  Steps until = Steps::share(60);
  Steps every = Steps::share(0.4, 50);
  double gradient_threshold = 2e-4;
  AutoCount max_gaussians = AutoCount::automatic(150000);
  McmcOptions mcmc;
  /// The first densification is after this step: 500 of 25,000, as in 3DGS. No key.
  Steps from = Steps::share(2);
  /// Steps between resets of all opacities to at most 0.01; 0: never; 3,000 of 25,000, as in 3DGS.
  /// No key.
  Steps opacity_reset_every = Steps::share(12, 1000);
  /// No opacity reset after this step, so that the scene recovers before the run ends. Derived from
  /// the number of steps, no key.
  int64_t last_opacity_reset = std::numeric_limits<int64_t>::max();
};

template <class V>
void describe(V& v, DensifyOptions& o) {
  v.field("strategy", o.strategy, "how Gaussians are added and removed");
  v.field("statistics", o.statistics,
          "which poses of an exposure contribute to the screen gradients");
  v.fixed("from", o.from);
  v.field("until", o.until,
          "no densification and no opacity reset from this step on; the first densification comes "
          "after 2 % of the run",
          Range{0, 1e9});
  v.field("every", o.every, "steps between densifications", Range{1, 1e9});
  v.field("gradient_threshold", o.gradient_threshold,
          "mean screen gradient (NDC) above which a Gaussian is cloned or split", Range{0, 1});
  v.fixed("split_scale", kSplitScale);
  v.fixed("prune_opacity", kPruneOpacity);
  v.fixed("prune_scale", kPruneScale);
  v.fixed("opacity_reset_every", o.opacity_reset_every);
  v.field("max_gaussians", o.max_gaussians,
          "upper bound of the number of Gaussians; auto: 500 times the root of a frame's pixels, "
          "at least 150000, but no more than a GPU's memory holds",
          Range{1, 1e8});
  v.group("mcmc", o.mcmc, "strategy mcmc");
}

/// Counts of one densification.
struct DensifyReport {
  int64_t cloned = 0, split = 0, pruned = 0, relocated = 0, added = 0;
  bool opacity_reset = false;
  /// True if rows were added, removed or moved: the parameters are then new tensors.
  bool changed() const { return cloned || split || pruned || relocated || added; }
};

/// Growth factor of one densification with strategy mcmc, chosen so that a shorter run adds as many
/// Gaussians as one of 25,000 steps.
double mcmc_growth(const DensifyOptions& options);

/// Whether a densification will read the screen gradients of the renders of `step`.
bool keeps_statistics(const DensifyOptions& options, int64_t step);

/// Adds and removes Gaussians during training, and updates the optimiser's rows accordingly. Steps
/// count from 1. All random samples come from the generator, on the CPU.
class Densifier {
 public:
  Densifier() = default;
  /// @param unit  length for which the noise and the size penalty of strategy mcmc are meant, in
  ///   units of the scene (data::length_unit)
  Densifier(const DensifyOptions& options, const GaussianModel& model, at::Generator generator,
            double unit = 1);

  /// How many of an exposure's `poses`, counted from the first, contribute to the statistics.
  int64_t counted_poses(int64_t poses) const {
    return options_.statistics == CountedPoses::kFirst ? 1 : poses;
  }

  /// True if update(step) will change anything (always with mcmc, because of its noise).
  bool due(int64_t step) const;

  /// Densifies if `step` is due; call it after the backward pass and the optimiser's step.
  /// Synchronises with the device only if rows change. Changed parameters have no gradient.
  /// @param gradient_factor  multiplies gradient_threshold
  DensifyReport update(int64_t step, GaussianModel& model, GaussianAdam& adam,
                       double gradient_factor = 1);

  /// Opacity and scale terms that strategy mcmc adds to the loss, a scalar; otherwise undefined.
  torch::Tensor regularization(const GaussianModel& model) const;

  const DensifyOptions& options() const { return options_; }
  at::Generator& generator() { return generator_; }
  const at::Generator& generator() const { return generator_; }
  /// The accumulators, for RenderOptions.statistics of steps with keeps_statistics(), and for
  /// checkpoints; undefined if no strategy reads them.
  const splat::ScreenStatistics& accumulated() const { return statistics_; }
  /// Zeroes the accumulators, one per Gaussian of the model.
  void reset_statistics(const GaussianModel& model);

 private:
  bool densify_due(int64_t step) const;
  bool opacity_reset_due(int64_t step) const;
  DensifyReport update_adc(int64_t step, double gradient_threshold, GaussianModel& model,
                           GaussianAdam& adam);
  DensifyReport update_mcmc(GaussianModel& model, GaussianAdam& adam);
  /// [N] mean screen gradient of each Gaussian since the last densification.
  torch::Tensor mean_gradient() const;

  DensifyOptions options_;
  at::Generator generator_;
  double unit_ = 1;
  splat::ScreenStatistics statistics_;
};

/// Clamps every opacity to at most 0.01 and zeroes its Adam moments.
void reset_opacities(GaussianModel& model, GaussianAdam& adam);

}  // namespace jade::gaussians
