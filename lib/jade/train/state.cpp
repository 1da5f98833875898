// SPDX-License-Identifier: Apache-2.0
#include "jade/train/state.h"

#include <limits>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/core/random.h"
#include "jade/data/origin.h"
#include "jade/gaussians/init.h"
#include "jade/imaging/color.h"
#include "jade/train/visit.h"

namespace jade::train {
namespace {

using TensorVisitor = std::function<void(const std::string&, const torch::Tensor&)>;

std::vector<geometry::Pose> camera_poses(const data::Dataset& dataset) {
  std::vector<geometry::Pose> poses;
  // Use the first pose of each exposure, as the original 3DGS backbone measures the scene.
  for (const data::Exposure& exposure : dataset.train) {
    if (!exposure.stray) poses.push_back(exposure.poses[0]);
  }
  return poses;
}

}  // namespace

gaussians::InitSources init_sources(const data::Dataset& dataset) {
  gaussians::InitSources sources;
  for (const data::Exposure& exposure : dataset.train) {
    if (exposure.stray) continue;
    sources.views.push_back({exposure.poses[geometry::kMidPose], exposure.camera, exposure.blurry,
                             exposure.mask, exposure.gain});
  }
  sources.origin = dataset.origin;
  sources.near = dataset.near;
  sources.far = dataset.far;
  sources.points.points = dataset.points;
  sources.points.colors = dataset.point_colors;
  return sources;
}

namespace {

/// Gray Gaussians: colours are linear in SH, so converting the coefficients converts the colours.
splat::Gaussians in_gray(splat::Gaussians start) {
  const torch::Tensor planes = start.sh.transpose(1, 2).unsqueeze(-1);  // [N,3,K,1]
  start.sh = imaging::as_gray(planes).squeeze(-1).transpose(1, 2).contiguous();
  return start;
}

}  // namespace

void TrainState::zero_grad() {
  visit([](const std::string&, const torch::Tensor& tensor) {
    if (tensor.defined() && tensor.requires_grad()) tensor.mutable_grad() = torch::Tensor();
  });
}

double gradient_factor(const RunOptions& options, int64_t moment_stride) {
  const losses::ObjectiveOptions& terms = options.objective;
  if (!terms.blur && !terms.simulation && !terms.intensity) return 1;
  const int64_t moments = (options.exposure.samples - 1) / moment_stride + 1;
  return static_cast<double>(geometry::kExposurePoses) / static_cast<double>(moments);
}

void TrainState::visit(const TensorVisitor& visitor) const {
  static_assert(member_count<TrainState>() == 9, "visit what a new member holds");
  visit_tensors(visitor, Member{"gaussians", gaussians.parameters()});
  visit_tensors(visitor, Member{"gaussian_adam.first", gaussian_adam.first_moments()});
  visit_tensors(visitor, Member{"gaussian_adam.second", gaussian_adam.second_moments()});
  visitor("gaussian_adam.step_count", gaussian_adam.step_count());
  visit_tensors(visitor, Member{"densifier", densifier.accumulated()});
  visit_tensors(visitor, Member{"allocation", allocation});
  visit_tensors(visitor, Member{"response", response});
  visit_tensors(visitor, Member{"poses", poses});
  visit_tensors(visitor, Member{"gains", gains});
  visit_tensors(visitor, Member{"pattern", pattern});
}

TrainState make_state(const RunOptions& options, const Start& start, torch::Device device) {
  const auto seed = static_cast<uint64_t>(options.seed);
  TrainState state;
  state.gaussians = gaussians::GaussianModel(start.gaussians, start.extent, device);
  state.gaussian_adam = gaussians::GaussianAdam(state.gaussians, options.optim, start.monochrome);
  state.densifier = gaussians::Densifier(options.densify, state.gaussians,
                                         make_generator(seed, "densification"), start.unit);
  if (options.objective.target == losses::Target::kRouted) {
    state.allocation.module =
        router::make_allocation(options.allocation, start.views, start.height, start.width,
                                make_generator(seed, "router start"));
  }
  if (state.allocation) {
    state.allocation->to(device);
    state.allocation.adam = ModuleAdam(state.allocation->parameters(), options.route.lr);
  }
  if (options.response.enabled) {
    state.response.module = std::make_shared<response::CameraResponseImpl>();
    state.response->to(device);
    if (options.response.lr > 0) {
      state.response.adam = ModuleAdam(state.response->parameters(), options.response.lr, 1e-15);
    }
  }
  return state;
}

void learn_poses(TrainState& state, const PoseOptions& options, const data::Dataset& dataset,
                 torch::Device device) {
  state.poses.module = make_exposure_poses(options, dataset);
  if (!state.poses) return;
  state.poses->to(device);
  state.poses.adam = RowAdam(state.poses->twists());
}

void learn_pattern(TrainState& state, const PatternOptions& options, const data::Dataset& dataset,
                   torch::Device device) {
  state.pattern.module = make_fixed_pattern(options, dataset);
  if (!state.pattern) return;
  state.pattern->to(device);
  // The gradient of an offset is that of a mean over pixels.
  state.pattern.adam = ModuleAdam(state.pattern->parameters(), options.lr, 1e-15);
}

void take_gains(TrainState& state, const GainOptions& options, const data::Dataset& dataset,
                torch::Device device) {
  state.gains.module = make_exposure_gains(options, dataset);
  if (!state.gains) return;
  state.gains->to(device);
  // The gradient of a gain is that of a mean over pixels, near the end below Adam's usual ε of
  // 1e-8.
  if (state.gains->learned()) state.gains.adam = RowAdam(state.gains->log_gains(), 1e-15);
}

namespace {

/// A strategy that adds none has no limit.
int64_t most_at_start(const gaussians::DensifyOptions& options) {
  const bool bounded = options.strategy != gaussians::DensifyStrategy::kNone;
  return bounded ? int64_t{options.max_gaussians} : std::numeric_limits<int64_t>::max();
}

/// Rejects parameters per sensor pixel for data sets with frames of several sizes.
/// @throws ConfigError naming the key.
void check_sizes(const RunOptions& options, const data::Dataset& dataset) {
  const auto& first = dataset.train.front().camera;
  const auto other =
      std::find_if(dataset.train.begin(), dataset.train.end(), [&](const data::Exposure& exposure) {
        return exposure.camera.width != first.width || exposure.camera.height != first.height;
      });
  if (other == dataset.train.end()) return;
  const char* key = nullptr;
  if (options.objective.target == losses::Target::kRouted &&
      options.allocation.kind == router::AllocationKind::kPerViewMap) {
    key = "allocation.kind per_view_map";
  }
  if (options.objective.event_loss_weight > 0) key = "objective.event_loss_weight";
  if (key == nullptr) return;
  throw ConfigError(concat(key, ": expected frames of one size, found ", first.width, "x",
                           first.height, " and ", other->camera.width, "x", other->camera.height,
                           " (", other->name, "); leave the key at its default"));
}

TrainState make_state(const RunOptions& options, const data::Dataset& dataset,
                      splat::Gaussians gaussians, torch::Device device) {
  check_sizes(options, dataset);
  const auto& camera = dataset.train.front().camera;
  Start start;
  start.gaussians = std::move(gaussians);
  start.extent = gaussians::scene_extent(camera_poses(dataset));
  start.unit = data::length_unit(dataset);
  start.monochrome = dataset.monochrome;
  start.views = static_cast<int64_t>(dataset.train.size());
  start.height = camera.height;
  start.width = camera.width;
  TrainState state = make_state(options, start, device);
  learn_poses(state, options.poses, dataset, device);
  take_gains(state, options.gains, dataset, device);
  learn_pattern(state, options.pattern, dataset, device);
  return state;
}

}  // namespace

TrainState make_state(const RunOptions& options, const data::Dataset& dataset,
                      torch::Device device) {
  auto generator = make_generator(static_cast<uint64_t>(options.seed), "initial points");
  auto gaussians = gaussians::initial_gaussians(options.init, init_sources(dataset), generator,
                                                most_at_start(options.densify));
  if (dataset.monochrome) gaussians = in_gray(std::move(gaussians));
  return make_state(options, dataset, std::move(gaussians), device);
}

TrainState make_state_to_load(const RunOptions& options, const data::Dataset& dataset,
                              torch::Device device) {
  const gaussians::PointCloud point{torch::zeros({1, 3}), torch::zeros({1, 3})};
  return make_state(options, dataset, gaussians::gaussians_from_points(point), device);
}

}  // namespace jade::train
