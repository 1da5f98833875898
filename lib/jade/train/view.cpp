// SPDX-License-Identifier: Apache-2.0
#include "jade/train/view.h"

#include <algorithm>
#include <cmath>
#include <future>
#include <optional>
#include <torch/types.h>
#include <utility>

#include "jade/core/check.h"
#include "jade/core/interrupt.h"
#include "jade/core/progress.h"
#include "jade/events/voxel.h"
#include "jade/imaging/image_io.h"
#include "jade/imaging/reblur.h"
#include "jade/restore/restored_exposure.h"
#include "jade/train/exposure_span.h"
#include "jade/train/plan.h"
#include "jade/train/sums_ahead.h"
#include "jade/train/view_memory.h"

namespace jade::train {
namespace {

bool has_masks(const data::Dataset& dataset) {
  return std::any_of(dataset.train.begin(), dataset.train.end(),
                     [](const data::Exposure& exposure) { return exposure.mask.defined(); });
}

/// The exposure's mask as a view has it, all ones where it has none itself.
torch::Tensor mask_of(const data::Exposure& exposure) {
  if (exposure.mask.defined()) return exposure.mask.to(torch::kFloat32);
  return torch::ones({1, exposure.blurry.size(1), exposure.blurry.size(2)});
}

/// Image with masked pixels set to 0.
torch::Tensor shown(const torch::Tensor& image, const torch::Tensor& mask) {
  return image.defined() && mask.defined() ? image * mask.to(image.scalar_type()) : image;
}

/// The exposure with a frame that is black under its mask.
data::Exposure masked(const data::Exposure& exposure) {
  data::Exposure out = exposure;
  if (out.mask.defined()) out.blurry = out.blurry.masked_fill(out.mask.logical_not(), 0);
  return out;
}

/// The image of train.target_images that has the view's name.
torch::Tensor target_image(const View& view, const std::filesystem::path& folder,
                           torch::Device device) {
  for (const auto& path : imaging::list_images(folder)) {
    if (path.stem() != view.name) continue;
    const auto image = imaging::read_image(path).to(device);
    if (image.sizes() != view.blurry.sizes()) {
      throw DataError(concat(path.string(), ": expected ", shape_string(view.blurry),
                             " as the training frame, found ", shape_string(image)));
    }
    return image;
  }
  throw DataError(concat(folder.string(), ": expected an image named ", view.name, ", found none"));
}

/// The target of Eq. (9) where it is made of the restorations and no router decides; else
/// undefined.
torch::Tensor restored_target(const restore::Restorations& restorations,
                              const RunOptions& options) {
  switch (options.objective.target) {
    case losses::Target::kEdi:
      return restorations.edi;
    case losses::Target::kEfnet:
      return restorations.efnet;
    case losses::Target::kMean:
      return restore::fuse(torch::full({}, 0.5, restorations.edi.options()), restorations);
    case losses::Target::kRouted:
      return routed_to_edi(options) ? restorations.edi : torch::Tensor();
    case losses::Target::kBlurry:
    case losses::Target::kImageFolder:
    case losses::Target::kNone:
      break;
  }
  return {};
}

/// The target of Eq. (9) where no router decides; undefined for a routed one or none.
torch::Tensor fixed_target(const View& view, const RunOptions& options, bool monochrome,
                           torch::Device device) {
  switch (options.objective.target) {
    case losses::Target::kBlurry:
      return view.blurry;
    case losses::Target::kImageFolder: {
      const torch::Tensor image = target_image(view, options.train.target_images, device);
      return shown(monochrome ? restore::without_tint(image) : image, view.mask);
    }
    default:
      return restored_target(view.restorations, options);
  }
}

bool restores_poses(const RunOptions& options) { return restored_every(options) > 0; }

/// c of Eq. (7). The paper's 1 makes the operator a scale-free surrogate; the calibrated c turns it
/// into the exposure model that EDI inverts.
double reblur_contrast(const events::EventVoxel& voxel, const RunOptions& options) {
  if (options.route.reblur_contrast > 0) return options.route.reblur_contrast;
  const auto thresholds = options.events.thresholds();
  return 0.5 * (thresholds.positive + thresholds.negative) * voxel.v_max;
}

/// The poses of an exposure at the moments of the run's quadrature.
std::vector<geometry::Pose> sample_poses(const data::Exposure& exposure, const ExposureSpan& span,
                                         const geometry::ExposureOptions& options) {
  if (options.samples == geometry::kExposurePoses) {
    return {exposure.poses.begin(), exposure.poses.end()};
  }
  std::vector<geometry::Pose> poses;
  for (const double u : geometry::quadrature(options.quadrature, options.samples).u) {
    poses.push_back(span.at(u));
  }
  return poses;
}

restore::RestoreOptions restore_options(const RunOptions& options) {
  restore::RestoreOptions out{options.events, options.exposure, 0};
  out.taught_contrast = options.objective.edi_contrast;
  out.times = restored_times(options);
  return out;
}

/// Constants of many moments in half the memory: it rounds by at most 0.05 %. One image that stands
/// for all of them stays one.
torch::Tensor in_half(const torch::Tensor& moments, const torch::Tensor& mask = {}) {
  const bool repeated = moments.size(0) > 1 && moments.stride(0) == 0;
  const torch::Tensor kept = repeated ? moments.narrow(0, 0, 1) : moments;
  return shown(kept.to(torch::kHalf), mask).expand(moments.sizes());
}

/// Whether L_edi and L_sim, or the target of a sampled pose, reads EDI as the thresholds have it.
bool reads_edi_at_poses(const RunOptions& options) {
  const losses::Target target = options.objective.target;
  return options.objective.edi_contrast == 1 ||
         (restores_poses(options) && target != losses::Target::kEfnet &&
          target != losses::Target::kNone);
}

/// Moves tensors that only pictures and the report read to the CPU: without a router, a step reads
/// the fixed target or the restoration at a sampled pose.
void put_aside_unread(const RunOptions& options, View& view) {
  view.density = view.density.cpu();
  if (options.objective.target == losses::Target::kRouted) return;
  if (restores_poses(options)) view.fixed_target = torch::Tensor();
  for (torch::Tensor* const each :
       {&view.psi, &view.reblur_kernel, &view.restorations.edi, &view.restorations.efnet}) {
    if (each->defined()) *each = each->cpu();
  }
}

/// Restorations at every restored pose of the view, for objective.restored_poses.
PoseRestorations restorations_of_poses(const restore::RestoredExposure& restored,
                                       const torch::Tensor& mask, const RunOptions& options) {
  const events::EventVoxel& voxel = restored.maps.voxel;
  PoseRestorations out;
  if (restored.efnet_at.defined()) out.efnet = moved(in_half(restored.efnet_at, mask), torch::kCPU);
  if (!plan_step(options, 1).route) return out;
  std::vector<torch::Tensor> psi, kernels;
  for (const double moment : restored_times(options)) {
    psi.push_back(events::polarity_projection(voxel.values, moment));
    kernels.push_back(imaging::reblur_kernel(voxel, reblur_contrast(voxel, options), moment));
  }
  const torch::Device device = restored.blurry.device();
  out.psi = torch::stack(psi).to(device);
  out.reblur_kernel = torch::stack(kernels).to(device);
  return out;
}

/// A view without blurry_moments, its frame, EDI factors and F at restored poses on the CPU: on a
/// GPU they would take the network's memory and cut it into pieces that cannot be given back.
View prepare_view(const data::Exposure& exposure, restore::ExposureSums sums,
                  const restore::RestoreOptions& how, const ExposureSpan& span,
                  const data::Dataset& dataset, const RunOptions& options,
                  restore::ViewRestorer& restorer) {
  const torch::Device device = restorer.device();
  const restore::RestoredExposure restored =
      restore::restore_exposure(masked(exposure), std::move(sums), how, restorer);
  const events::EventVoxel& voxel = restored.maps.voxel;
  View view;
  view.name = exposure.name;
  view.blurry = restored.blurry;
  if (has_masks(dataset)) view.mask = mask_of(exposure).to(device);
  view.psi = events::polarity_projection(voxel.values.to(device));
  view.density = restored.maps.density.to(device);
  view.reblur_kernel = imaging::reblur_kernel(voxel, reblur_contrast(voxel, options)).to(device);
  if (reads_edi_at_poses(options)) view.edi_factors = restored.gain.unsqueeze(1).cpu();
  if (options.objective.edi_contrast != 1) {
    view.taught_factors = moved(in_half(restored.taught_gain.unsqueeze(1)), torch::kCPU);
  }
  view.restorations = {shown(restored.restorations.edi, view.mask),
                       shown(restored.restorations.efnet, view.mask)};
  const geometry::Quadrature sum =
      geometry::quadrature(options.exposure.quadrature, options.exposure.samples);
  view.cameras =
      camera_batch(sample_poses(exposure, span, options.exposure), exposure.camera, device);
  view.u = torch::tensor(sum.u, torch::kFloat64).to(device);
  if (options.exposure.quadrature == geometry::QuadratureRule::kTrapezoid) {
    view.weights = torch::tensor(sum.weights, torch::kFloat64).to(device, torch::kFloat32);
  }
  view.fixed_target = fixed_target(view, options, dataset.monochrome, device);
  if (restores_poses(options)) {
    view.restored_poses = restorations_of_poses(restored, view.mask, options);
  }
  put_aside_unread(options, view);
  for (torch::Tensor* const each : {&view.blurry, &view.mask, &view.fixed_target}) {
    *each = moved(*each, torch::kCPU);
  }
  return view;
}

}  // namespace

View at_pose(const View& view, int64_t pose, const RunOptions& options) {
  JADE_CHECK(pose >= 0 && pose < view.u.size(0), "expected a pose below ", view.u.size(0),
             ", found ", pose);
  const int64_t row = pose / std::max<int64_t>(restored_every(options), 1);
  const torch::Device device = view.blurry.device();
  const auto replace = [&](torch::Tensor& of_middle, const torch::Tensor& of_poses) {
    if (of_poses.defined()) of_middle = fetched(of_poses[row], device);
  };
  View out = view;
  out.restored_poses = {};
  const bool efnet_alone = options.objective.target == losses::Target::kEfnet;
  out.restorations.edi =
      efnet_alone ? torch::Tensor() : view.blurry * fetched(view.edi_factors[pose], device);
  replace(out.restorations.efnet, view.restored_poses.efnet);
  replace(out.psi, view.restored_poses.psi);
  replace(out.reblur_kernel, view.restored_poses.reblur_kernel);
  out.fixed_target = restored_target(out.restorations, options);
  return out;
}

std::string restorer_sha256(const RunOptions& options) {
  return needs_efnet(options) ? restore::checked_file_sha256(options.efnet) : "";
}

double near_plane(const SplatOptions& options, const data::Dataset& dataset) {
  return options.near_plane > 0 ? options.near_plane : std::min(0.2, 0.5 * dataset.near);
}

int64_t max_gaussians(const gaussians::DensifyOptions& options, const data::Dataset& dataset) {
  if (!options.max_gaussians.is_auto()) return options.max_gaussians;
  const auto& camera = dataset.train.front().camera;
  const double side = std::sqrt(double(camera.width) * camera.height);
  return std::max(int64_t{options.max_gaussians}, int64_t(std::lround(500 * side)));
}

splat::RenderOptions render_options(const RunOptions& options) {
  splat::RenderOptions render;
  if (options.splat.near_plane > 0) render.near_plane = options.splat.near_plane;
  render.deterministic = options.deterministic;
  return render;
}

torch::Tensor pose_times(torch::Device device) {
  return torch::linspace(0, 1, geometry::kExposurePoses, torch::kFloat64).to(device);
}

splat::CameraBatch camera_batch(const std::vector<geometry::Pose>& camera_from_world,
                                const geometry::Intrinsics& camera, torch::Device device) {
  const auto count = static_cast<int64_t>(camera_from_world.size());
  const auto options = torch::TensorOptions(device).dtype(torch::kFloat32);
  splat::CameraBatch batch;
  batch.camera_from_world = geometry::to_tensor(camera_from_world).to(options);
  batch.intrinsics = geometry::to_tensor(camera).to(options).expand({count, 4}).contiguous();
  batch.width = camera.width;
  batch.height = camera.height;
  return batch;
}

std::vector<View> prepare_views(const data::Dataset& dataset, const RunOptions& options,
                                torch::Device device, std::future<restore::Restorer> early) {
  const torch::NoGradGuard no_grad;
  const auto efnet = needs_efnet(options) ? std::optional(options.efnet) : std::nullopt;
  restore::ViewRestorer restorer(options.cache, efnet, device, dataset.monochrome,
                                 std::move(early));
  if (efnet && restores_poses(options)) restorer.check_times(restored_times(options));
  Progress progress("restoring", static_cast<int64_t>(dataset.train.size()), 0, "views");
  std::vector<View> views;
  const std::vector<ExposureSpan> spans = exposure_spans(dataset);
  const restore::RestoreOptions how = restore_options(options);
  // A CPU that restores has no threads to spare.
  SumsAhead sums(dataset, how, efnet ? &restorer.metadata() : nullptr,
                 device.is_cuda() ? std::launch::async : std::launch::deferred);
  for (size_t i = 0; i < spans.size(); ++i) {
    throw_if_interrupted();
    views.push_back(
        prepare_view(dataset.train[i], sums.next(), how, spans[i], dataset, options, restorer));
    if (progress.step()) progress.show();
  }
  restorer.leave();
  place_constants(options, device, kMostConstantBytes, views);
  return views;
}

}  // namespace jade::train
