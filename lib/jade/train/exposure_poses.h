// SPDX-License-Identifier: Apache-2.0
// Exposure poses that are learned with the scene, as in BAD-Gaussians (Zhao et al., ECCV 2024) or
// as a correction of the data's.
#pragma once

#include <memory>
#include <torch/nn/module.h>
#include <torch/types.h>
#include <vector>

#include "jade/core/fields.h"
#include "jade/data/exposure.h"
#include "jade/train/pose_gauge.h"

namespace jade::train {

/// The learned path through an exposure.
enum class PosePath { kNone, kLinear, kCubic };

constexpr auto words_of(PosePath) {
  return std::array{Word{"none", PosePath::kNone, "keep the data's poses"},
                    Word{"linear", PosePath::kLinear, "between two poses in SE(3)"},
                    Word{"cubic", PosePath::kCubic, "along a B-spline of four poses"}};
}

/// Initial path of learned poses.
enum class PoseStart { kLine, kData };

constexpr auto words_of(PoseStart) {
  return std::array{
      Word{"line", PoseStart::kLine, "the line from the exposure's first pose to its last"},
      Word{"data", PoseStart::kData, "the data's path, multiplied by a correction"}};
}

struct PoseOptions {
  PosePath optimize = PosePath::kCubic;
  PoseStart start = PoseStart::kData;
  int64_t control_poses = 12;
  double lr = 3e-4;
  int64_t test_fit_steps = 100;
  /// Steps over which the step size decreases: 30,000 of 25,000, as in BAD-Gaussians. No key.
  Steps lr_max_steps = Steps::share(120);
};

/// Ratio of the poses' initial to final step size, as in BAD-Gaussians.
constexpr double kPoseLrFall = 100;

template <class V>
void describe(V& v, PoseOptions& o) {
  v.field("optimize", o.optimize, "learn the camera's path through each exposure");
  v.field("start", o.start, "initial path, which the learned twists change");
  v.field("control_poses", o.control_poses,
          "twists per exposure of a cubic correction (start data): more follow faster errors; "
          "other cubic paths have 4",
          Range{4, 64});
  v.field("lr", o.lr,
          "Adam step size of the poses at step 0; decreases log-linearly, to a hundredth after 1.2 "
          "times the steps of the run",
          Range{0, 1});
  v.fixed("lr_final", [&o] { return o.lr / kPoseLrFall; });
  v.fixed("lr_max_steps", o.lr_max_steps);
  v.fixed("prior_px", 0);
  v.fixed("prior_weight", 2.5e-4);
  v.field("test_fit_steps", o.test_fit_steps,
          "if poses are learned: steps to fit the pose of each test view to its image, with the "
          "scene fixed, before scoring",
          Range{0, 1e6});
}

/// The step size of the poses at `step` (counted from 1).
double pose_lr(const PoseOptions& options, int64_t step);

/// The learned path of every exposure, by two twists (linear) or four and more (cubic) that start
/// at zero, float64, differentiable on any device without synchronisation; geometry/exposure_path.h
/// has the equations.
///
/// kLine, as BAD-Gaussians: twists move the control poses of a path that starts as the SE(3) line
/// from the exposure's first pose to its last. The data's poses between them are ignored, and a
/// line or one spline segment limits the motion within an exposure.
///
/// kData: world_from_camera(u) = data(u) · exp(ξ(u)), ξ(u) linear or a cubic B-spline. A run starts
/// at exactly the data's poses and preserves their motion within the exposure, however irregular;
/// it learns only their error, which is small and changes slowly.
class ExposurePoses : public torch::nn::Module {
 public:
  /// @param options  optimize is kLinear or kCubic.
  /// @param dataset  its training exposures share one camera; needs its depth bounds
  ExposurePoses(const PoseOptions& options, const data::Dataset& dataset);

  /// camera_from_world of an exposure at the times u, [M,4,4] float32; differentiable in the
  /// twists.
  /// @param exposure  [1] int64
  /// @param u         [M] float64, in units of the exposure
  /// @param data      [M,4,4] camera_from_world, the data's at these times; only kData reads them
  torch::Tensor forward(const torch::Tensor& exposure, const torch::Tensor& u,
                        const torch::Tensor& data) const;

  /// Call after each update: for kData, removes from the twists the motion and scale that all
  /// cameras share (pose_gauge.h), so that the learned poses stay in the data's world. This moves
  /// all exposures, including those that the update did not change, by 1/V of an update. Removing
  /// it less often, for example once per epoch, would move all cameras by one large step, which the
  /// scene would have to follow. Adam's moments are unchanged: they contain gradients of each
  /// exposure, whereas this changes the world's axes. Does nothing for kLine.
  void hold_gauge();

  /// [V,K,6], the parameter; translations in data::length_unit
  const torch::Tensor& twists() const { return twists_; }

 private:
  PoseStart start_;
  torch::Tensor control_;  ///< [V,K,4,4] world_from_camera, the control poses of kLine
  PoseGauge gauge_;        ///< for kData
  torch::Tensor twists_;   ///< with translations in `unit_`
  torch::Tensor unit_;     ///< [6]: data::length_unit and ones; undefined if all are 1
};

/// nullptr if the data's poses are not learned.
std::shared_ptr<ExposurePoses> make_exposure_poses(const PoseOptions& options,
                                                   const data::Dataset& dataset);

}  // namespace jade::train
