// SPDX-License-Identifier: Apache-2.0
// Exposure poses that are learned with the scene, as BAD-Gaussians does (Zhao et al., ECCV 2024).
#pragma once

#include <memory>
#include <torch/nn/module.h>
#include <torch/types.h>
#include <vector>

#include "jade/core/fields.h"
#include "jade/data/exposure.h"

namespace jade::train {

/// The learned path through an exposure.
enum class PosePath { kNone, kLinear, kCubic };

constexpr auto words_of(PosePath) {
  return std::array{Word{"none", PosePath::kNone, "the poses of the data stay"},
                    Word{"linear", PosePath::kLinear, "between two poses in SE(3)"},
                    Word{"cubic", PosePath::kCubic, "along a B-spline of four poses"}};
}

struct PoseOptions {
  PosePath optimize = PosePath::kNone;
  double lr = 1e-3;
  double lr_final = 1e-5;
  Steps lr_max_steps = Steps::share(120);
  int64_t accumulate = 1;
  int64_t test_fit_steps = 200;
};

template <class V>
void describe(V& v, PoseOptions& o) {
  v.field("optimize", o.optimize, "learn the camera's path through each exposure");
  v.field("lr", o.lr, "Adam step size of the poses at step 0", Range{0, 1});
  v.field("lr_final", o.lr_final, "the same at lr_max_steps; log-linear between", Range{0, 1});
  v.field("lr_max_steps", o.lr_max_steps, "steps over which it falls", Range{1, 1e9});
  v.field("accumulate", o.accumulate, "steps whose pose gradients are added up for one Adam step",
          Range{1, 1e6});
  v.field("test_fit_steps", o.test_fit_steps,
          "where poses are learned: steps that fit the pose of each test view to its image, the "
          "scene held, before it is scored",
          Range{0, 1e6});
}

/// The step size of the poses at `step` (counted from 1).
double pose_lr(const PoseOptions& options, int64_t step);

/// Control poses of every exposure: those of its start and its end (linear), or the four of a
/// uniform cumulative cubic B-spline whose middle segment is the exposure. Each is a constant first
/// guess moved by a learned twist ξ, world_from_camera · exp(ξ); all arithmetic is float64 on the
/// CPU. At the start the path is the SE(3) line from the exposure's first pose to its last.
class ExposurePoses : public torch::nn::Module {
 public:
  /// @param path  kLinear or kCubic.
  ExposurePoses(PosePath path, const std::vector<data::Exposure>& exposures);

  /// camera_from_world of the nine poses of an exposure, [9,4,4] float32 on `device`;
  /// differentiable in the twists.
  torch::Tensor forward(int64_t exposure, torch::Device device) const;

 private:
  torch::Tensor guess_;   ///< [V,K,4,4] world_from_camera
  torch::Tensor twists_;  ///< [V,K,6], the parameter
};

/// nullptr where the poses of the data stay.
std::shared_ptr<ExposurePoses> make_exposure_poses(const PoseOptions& options,
                                                   const std::vector<data::Exposure>& exposures);

}  // namespace jade::train
