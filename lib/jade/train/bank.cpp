// SPDX-License-Identifier: Apache-2.0
#include "jade/train/bank.h"

#include <algorithm>
#include <initializer_list>
#include <map>
#include <torch/cuda.h>
#include <torch/types.h>
#include <utility>

#include "jade/core/check.h"
#include "jade/core/device.h"
#include "jade/core/digest.h"
#include "jade/core/interrupt.h"
#include "jade/core/progress.h"
#include "jade/events/voxel.h"
#include "jade/imaging/edi.h"
#include "jade/imaging/image_io.h"
#include "jade/imaging/reblur.h"
#include "jade/imaging/ssim.h"
#include "jade/train/exposure_span.h"
#include "jade/train/plan.h"

namespace jade::train {
namespace {

/// Remaining bytes of device memory for constants.
class Budget {
 public:
  explicit Budget(int64_t bytes) : left_(bytes) {}

  /// Reserves that many bytes, or returns false.
  bool take(int64_t bytes) {
    if (bytes > left_) return false;
    left_ -= bytes;
    return true;
  }

 private:
  int64_t left_;
};

/// The tensor on the device, in float32. Does not wait for the device: a copy from the CPU goes
/// through page-locked memory.
torch::Tensor fetched(const torch::Tensor& tensor, torch::Device device) {
  if (!tensor.defined() || tensor.device().type() == device.type()) {
    return tensor.defined() ? tensor.to(torch::kFloat32) : tensor;
  }
  const torch::Tensor locked = torch::empty_like(tensor, tensor.options().pinned_memory(true));
  locked.copy_(tensor);
  return locked.to(device, /*non_blocking=*/true).to(torch::kFloat32);
}

/// The view's tensor, or undefined if the bank does not store this kind.
torch::Tensor of(const PerView& kind, size_t view) {
  return kind.empty() ? torch::Tensor() : kind[view];
}

/// The view's map at a moment, without copying it.
torch::Tensor at_moment(const PerView& kind, size_t view, int64_t moment) {
  return kind[view][std::min(moment, kind[view].size(0) - 1)];
}

int64_t bytes_of(const PerView& kind) {
  int64_t bytes = 0;
  for (const torch::Tensor& each : kind) bytes += static_cast<int64_t>(each.nbytes());
  return bytes;
}

void move(PerView& kind, torch::Device device) {
  for (torch::Tensor& each : kind) each = each.to(device);
}

bool has_masks(const data::Dataset& dataset) {
  return std::any_of(dataset.train.begin(), dataset.train.end(),
                     [](const data::Exposure& exposure) { return exposure.mask.defined(); });
}

/// Image with masked pixels set to 0.
torch::Tensor shown(const torch::Tensor& image, const torch::Tensor& mask) {
  return image.defined() && mask.defined() ? image * mask.to(image.scalar_type()) : image;
}

/// The files in train.target_images that have the names of the exposures, in their order.
std::vector<std::filesystem::path> target_paths(const data::Dataset& dataset,
                                                const std::filesystem::path& folder) {
  std::map<std::string, std::filesystem::path> found;
  for (const auto& path : imaging::list_images(folder)) found.try_emplace(path.stem(), path);
  std::vector<std::filesystem::path> paths;
  for (const data::Exposure& exposure : dataset.train) {
    const auto at = found.find(exposure.name);
    if (at == found.end()) {
      throw DataError(
          concat(folder.string(), ": expected an image named ", exposure.name, ", found none"));
    }
    paths.push_back(at->second);
  }
  return paths;
}

torch::Tensor target_image(const data::Exposure& exposure, const std::filesystem::path& path) {
  const auto image = imaging::read_image(path);
  if (image.sizes() != exposure.blurry.sizes()) {
    throw DataError(concat(path.string(), ": expected ", shape_string(exposure.blurry),
                           " as the training frame, found ", shape_string(image)));
  }
  return image;
}

/// The target of Eq. (9) if it consists of the restorations and no router is used; else undefined.
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
    case losses::Target::kBlurry:
    case losses::Target::kImageFolder:
    case losses::Target::kNone:
      break;
  }
  return {};
}

bool restores_poses(const RunOptions& options) { return restored_every(options) > 0; }

/// c of Eq. (7). With the paper's 1 the operator is a scale-free surrogate; with the calibrated c
/// it is the exposure model that EDI inverts.
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

/// Whether the target of a sampled pose reads EDI with the uncalibrated thresholds.
bool targets_edi_at_poses(const RunOptions& options) {
  const losses::Target target = options.objective.target;
  return restores_poses(options) && target != losses::Target::kEfnet &&
         target != losses::Target::kNone;
}

/// Stores a view's maps on the CPU: on a GPU they would fragment the memory of the network.
void put(PerView& kind, const torch::Tensor& maps, const torch::Tensor& mask = {}) {
  if (maps.defined()) kind.push_back(shown(maps, mask).cpu());
}

/// A CPU that runs the restorer has no threads to spare.
std::launch policy_on(torch::Device device) {
  return device.is_cuda() ? std::launch::async : std::launch::deferred;
}

/// `how`, once the network is known to restore at all its moments.
const restore::RestoreOptions& checked(const restore::RestoreOptions& how,
                                       const restore::ViewRestorer& restorer,
                                       const RunOptions& options) {
  if (restorer.has_network() && restores_poses(options)) restorer.check_times(how.times);
  return how;
}

/// Maps at all moments in the stored type; an exposure of zero length has one for all.
torch::Tensor kept(const torch::Tensor& moments, bool lasts, torch::Dtype type) {
  return (lasts ? moments : moments.narrow(0, 0, 1)).to(type);
}

}  // namespace

void load_kernels(torch::Device device) {
  const torch::NoGradGuard no_grad;
  start_device(device);
  const torch::Tensor windows = torch::zeros({2, 8, 8}, device), u = torch::zeros({1}, device);
  imaging::edi_gain(windows, geometry::QuadratureRule::kTrapezoid, u.to(torch::kFloat64), 1.3);
  imaging::ssim_target(torch::zeros({3, 8, 8}, device));
}

Restoring::Restoring(const data::Dataset& dataset, const RunOptions& options, torch::Device device,
                     std::future<restore::Restorer> early, int64_t most_device_bytes)
    : how(restore_options(options)),
      restorer(options.cache, needs_efnet(options) ? std::optional(options.efnet) : std::nullopt,
               device, dataset.monochrome, std::move(early)),
      sums(dataset, checked(how, restorer, options), restorer, policy_on(device),
           most_device_bytes) {}

ViewBank::ViewBank(const data::Dataset& dataset, const RunOptions& options, torch::Device device,
                   std::unique_ptr<Restoring> begun, int64_t most_device_bytes)
    : options_(options), device_(device) {
  const torch::NoGradGuard no_grad;
  if (!begun) {
    begun = std::make_unique<Restoring>(dataset, options, device, std::future<restore::Restorer>(),
                                        most_device_bytes);
  }
  restore::ViewRestorer& restorer = begun->restorer;
  Progress progress("restoring", static_cast<int64_t>(dataset.train.size()), 0, "views");
  const std::vector<ExposureSpan> spans = exposure_spans(dataset);
  const bool masks = has_masks(dataset);
  const geometry::Quadrature sum =
      geometry::quadrature(options.exposure.quadrature, options.exposure.samples);
  u_ = torch::tensor(sum.u, torch::kFloat64).to(device);
  if (options.exposure.quadrature == geometry::QuadratureRule::kTrapezoid) {
    weights_ = torch::tensor(sum.weights, torch::kFloat64).to(device, torch::kFloat32);
  }
  std::vector<std::filesystem::path> targets(spans.size());
  if (options.objective.target == losses::Target::kImageFolder)
    targets = target_paths(dataset, options.train.target_images);
  std::future<void> stored;  // of the exposure before, while the network restores the next
  for (size_t i = 0; i < spans.size(); ++i) {
    throw_if_interrupted();
    const data::Exposure exposure = masked(dataset.train[i]);
    restore::RestoredExposure restored =
        restore::restore_exposure(exposure, begun->sums.next(), begun->how, restorer);
    if (stored.valid()) stored.get();
    // Other threads use another stream: they must find these tensors complete, and may reuse the
    // memory of the windows as soon as it is freed.
    if (device.is_cuda()) torch::cuda::synchronize(device.index());
    restored.windows.reset();
    stored = std::async(policy_on(device),
                        [this, &dataset, &spans, &targets, i, masks, exposure, restored] {
                          const torch::NoGradGuard on_this_thread;
                          add(exposure, spans[i], masks, dataset.monochrome, targets[i], restored);
                        });
    if (!device.is_cuda()) stored.get();
    if (progress.step()) progress.show();
  }
  if (stored.valid()) stored.get();
  restorer.leave();
  restorer.note_restored(options.dataset.path);
  place(most_device_bytes);
}

void ViewBank::add(const data::Exposure& exposure, const ExposureSpan& span, bool masks,
                   bool monochrome, const std::filesystem::path& target,
                   const restore::RestoredExposure& restored) {
  const bool lasts = exposure.duration_us() > 0;
  if (is_routed()) {
    add_routed(exposure, restored.maps.voxel);
  } else {
    put(measured_, exposure.blurry.contiguous());
  }
  torch::Tensor mask;
  if (exposure.mask.defined()) mask = exposure.mask.to(device_, torch::kFloat32);
  if (masks) put(masks_, mask.defined() ? mask : torch::ones_like(exposure.blurry.narrow(0, 0, 1)));

  const bool printed = options_.objective.edi_contrast == 1;
  put(edi_, kept(restored.taught_gain.unsqueeze(1), lasts, printed ? torch::kFloat : torch::kHalf));
  if (!printed && targets_edi_at_poses(options_)) {
    put(target_edi_, kept(restored.gain.unsqueeze(1), lasts, torch::kFloat));
  }
  if (restored.efnet_at.defined()) {
    put(efnet_, kept(restored.efnet_at, lasts, torch::kHalf), mask);
  }
  put(middle_edi_, restored.restorations.edi, mask);
  put(middle_efnet_, restored.restorations.efnet, mask);
  put(density_, restored.maps.density);
  if (options_.objective.target == losses::Target::kImageFolder) {
    const torch::Tensor image = target_image(exposure, target);
    put(fixed_targets_, monochrome ? restore::without_tint(image) : image, exposure.mask);
  } else if (!restores_poses(options_) && !is_routed()) {
    put(fixed_targets_, restored_target(restored.restorations, options_), mask);
  }
  cameras_.push_back(
      camera_batch(sample_poses(exposure, span, options_.exposure), exposure.camera, device_));
}

void ViewBank::add_routed(const data::Exposure& exposure, const events::EventVoxel& voxel) {
  const double contrast = reblur_contrast(voxel, options_);
  put(measured_, torch::cat({exposure.blurry, events::polarity_projection(voxel.values)}));
  put(middle_reblur_kernel_, imaging::reblur_kernel(voxel, contrast));
  if (!restores_poses(options_)) return;
  std::vector<torch::Tensor> psi, kernels;
  for (const double moment : restored_times(options_)) {
    psi.push_back(events::polarity_projection(voxel.values, moment));
    kernels.push_back(imaging::reblur_kernel(voxel, contrast, moment));
  }
  put(psi_, torch::stack(psi));
  put(reblur_kernel_, torch::stack(kernels));
}

void ViewBank::place(int64_t most_bytes) {
  Budget budget(most_bytes);
  const bool all = !device_.is_cuda();
  const auto place_kinds = [&](std::initializer_list<PerView*> kinds) {
    for (PerView* const kind : kinds) move(*kind, device_);
  };
  int64_t frames = bytes_of(fixed_targets_) + bytes_of(measured_) + bytes_of(masks_);
  for (const torch::Tensor& each : measured_) frames += 2 * each.narrow(0, 0, 3).nbytes();
  const bool near = budget.take(frames) || all || is_routed();
  if (near) place_kinds({&measured_, &masks_, &fixed_targets_});
  for (const torch::Tensor& each : measured_) {
    const auto target = imaging::ssim_target(each.narrow(0, 0, 3).to(device_));
    const torch::Device where = near ? device_ : torch::kCPU;
    window_means_.push_back(target.mean.to(where));
    window_squares_.push_back(target.square.to(where));
  }
  if (budget.take(bytes_of(edi_) + bytes_of(target_edi_)) || all) {
    place_kinds({&edi_, &target_edi_});
  }
  if (budget.take(bytes_of(efnet_)) || all) place_kinds({&efnet_});
  if (is_routed()) {
    place_kinds({&psi_, &reblur_kernel_, &middle_edi_, &middle_efnet_, &middle_reblur_kernel_});
  }
}

restore::Restorations ViewBank::restorations_at(size_t view, int64_t pose,
                                                const torch::Tensor& blurry) const {
  restore::Restorations restorations;
  if (targets_edi_at_poses(options_)) {
    const PerView& factors = target_edi_.empty() ? edi_ : target_edi_;
    restorations.edi = blurry * fetched(at_moment(factors, view, pose), device_);
  }
  if (!efnet_.empty()) {
    restorations.efnet = fetched(at_moment(efnet_, view, pose / restored_every(options_)), device_);
  }
  return restorations;
}

View ViewBank::step_view(int64_t view, std::optional<int64_t> pose) const {
  JADE_CHECK(!pose || (*pose >= 0 && *pose < u_.size(0)), "expected a pose below ", u_.size(0),
             ", found ", *pose);
  const auto i = static_cast<size_t>(view);
  View out;
  out.measured = fetched(measured_[i], device_);
  out.window_mean = fetched(window_means_[i], device_);
  out.window_square = fetched(window_squares_[i], device_);
  out.mask = fetched(of(masks_, i), device_);
  out.cameras = cameras_[i];
  out.u = u_;
  out.weights = weights_;
  if (options_.objective.target == losses::Target::kBlurry) {
    out.fixed_target = out.blurry();
  } else if (!fixed_targets_.empty()) {
    out.fixed_target = fetched(fixed_targets_[i], device_);
  } else {
    const restore::Restorations restorations =
        pose ? restorations_at(i, *pose, out.blurry())
             : restore::Restorations{middle_edi_[i], of(middle_efnet_, i)};
    out.fixed_target = restored_target(restorations, options_);
    if (!is_routed()) return out;
    out.restorations = restorations;
    out.reblur_kernel = middle_reblur_kernel_[i];
    if (!pose || psi_.empty()) return out;
    const int64_t row = *pose / restored_every(options_);
    out.measured = torch::cat({out.blurry(), psi_[i][row]});
    out.reblur_kernel = reblur_kernel_[i][row];
  }
  return out;
}

losses::EdiFactors ViewBank::edi_factors(int64_t view,
                                         const std::array<int64_t, 3>& moments) const {
  const auto at = [&](int64_t moment) {
    return fetched(at_moment(edi_, static_cast<size_t>(view), moment), device_);
  };
  return {at(moments[0]), at(moments[1]), at(moments[2])};
}

torch::Tensor ViewBank::edi_factors(int64_t view) const {
  return edi_[static_cast<size_t>(view)].expand({u_.size(0), -1, -1, -1});
}

View ViewBank::picture_view(int64_t view) const {
  const auto i = static_cast<size_t>(view);
  View out;
  out.measured = measured_[i];
  out.mask = of(masks_, i);
  out.reblur_kernel = of(middle_reblur_kernel_, i);
  out.restorations = {middle_edi_[i], of(middle_efnet_, i)};
  return out;
}

ConstantBytes ViewBank::bytes_on_device() const {
  const auto sum = [&](std::initializer_list<const PerView*> kinds) {
    int64_t bytes = 0;
    for (const PerView* const kind : kinds) {
      if (!kind->empty() && kind->front().device().type() == device_.type())
        bytes += bytes_of(*kind);
    }
    return bytes;
  };
  ConstantBytes bytes{sum({&measured_, &window_means_, &window_squares_, &masks_}),
                      sum({&edi_, &target_edi_}),
                      sum({&fixed_targets_, &efnet_, &psi_, &reblur_kernel_, &middle_edi_,
                           &middle_efnet_, &middle_reblur_kernel_})};
  return bytes;
}

std::string target_images_sha256(const data::Dataset& dataset, const RunOptions& options) {
  if (options.objective.target != losses::Target::kImageFolder) return "";
  Sha256 digest;
  for (const auto& path : target_paths(dataset, options.train.target_images)) {
    digest.update(file_sha256(path));
  }
  return digest.hex();
}

std::string restorer_sha256(const RunOptions& options) {
  return needs_efnet(options) ? restore::restorer_file_sha256(options.efnet) : "";
}

}  // namespace jade::train
