// SPDX-License-Identifier: Apache-2.0
#include "run_input.h"

#include <nlohmann/json.hpp>
#include <vector>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/io/npy.h"
#include "jade/train/plan.h"

namespace jade::bench {
namespace {

using Tensors = std::vector<torch::Tensor>;

void write(const std::filesystem::path& folder, const char* name, const torch::Tensor& tensor) {
  io::write_npy(folder / (std::string(name) + ".npy"), tensor.detach().cpu().contiguous());
}

/// Test views have the camera of the training views in all data sets of this project.
void write_test_views(const data::Dataset& dataset, const std::filesystem::path& folder) {
  Tensors images, cameras;
  for (const data::SharpView& view : dataset.test) {
    images.push_back(view.image);
    cameras.push_back(geometry::to_tensor(view.pose));
  }
  write(folder, "test_images", torch::stack(images));
  write(folder, "test_camera_from_world", torch::stack(cameras).to(torch::kFloat32));
}

void throw_not_fixed() {
  throw ConfigError(
      "--write-input: expected a target at mid-exposure that no router decides, found another; add "
      "--set objective.target=efnet --set objective.restored_poses=middle");
}

void write_training_views(const train::ViewBank& bank, const std::filesystem::path& folder) {
  Tensors blurry, factors, targets, cameras;
  for (int64_t i = 0; i < bank.size(); ++i) {
    const train::View view = bank.step_view(i);
    if (!view.fixed_target.defined()) throw_not_fixed();
    blurry.push_back(view.blurry().cpu());
    factors.push_back(bank.edi_factors(i).to(torch::kCPU, torch::kFloat32));
    targets.push_back(view.fixed_target.cpu());
    cameras.push_back(view.cameras.camera_from_world);
  }
  write(folder, "blurry", torch::stack(blurry));
  write(folder, "edi_factors", torch::stack(factors));
  write(folder, "targets", torch::stack(targets));
  write(folder, "camera_from_world", torch::stack(cameras));
  write(folder, "intrinsics", bank.step_view(0).cameras.intrinsics[0]);
}

nlohmann::json numbers_of(const run::Trainer& trainer) {
  const train::RunOptions& options = trainer.options();
  const auto steps = [](const Steps& count) { return static_cast<int64_t>(count); };
  return {{"iterations", steps(options.train.iterations)},
          {"sh_degree_every", steps(options.train.sh_degree_every)},
          {"near_plane", train::render_options(options).near_plane},
          {"extent", trainer.state().gaussians.extent()},
          {"dssim", options.objective.dssim},
          {"target_weight", options.objective.target_weight},
          {"edi_weight", losses::kEdiWeight},
          {"warmup", steps(options.objective.warmup)},
          {"simulation_start", steps(options.objective.simulation_start)},
          {"position_lr_start", options.optim.position_lr_start},
          {"position_lr_end", options.optim.position_lr_start / gaussians::kPositionLrFall},
          {"position_lr_max_steps", steps(options.optim.position_lr_max_steps)},
          {"sh_dc_lr", options.optim.sh_dc_lr},
          {"sh_rest_lr", options.optim.sh_rest_lr},
          {"opacity_lr", options.optim.opacity_lr},
          {"scale_lr", options.optim.scale_lr},
          {"rotation_lr", options.optim.rotation_lr},
          {"eps", gaussians::kAdamEps},
          {"densify_from", steps(options.densify.from)},
          {"densify_until", steps(options.densify.until)},
          {"densify_every", steps(options.densify.every)},
          {"gradient_threshold", options.densify.gradient_threshold},
          {"split_scale", gaussians::kSplitScale},
          {"prune_opacity", gaussians::kPruneOpacity},
          {"prune_scale", gaussians::kPruneScale},
          {"max_gaussians", int64_t{options.densify.max_gaussians}},
          {"opacity_reset_every", steps(options.densify.opacity_reset_every)}};
}

}  // namespace

void check_run_input(const train::RunOptions& options) {
  if (options.objective.target == losses::Target::kRouted || train::restored_every(options) > 0) {
    throw_not_fixed();
  }
  if (train::mean_share_of_moments(options) < 1) {
    throw ConfigError(
        "--write-input: expected steps with all moments, as other programs take them, found fewer "
        "early; set train.quarter_moments_until and train.half_moments_until to 0");
  }
}

void write_run_input(const run::Trainer& trainer, const std::filesystem::path& folder) {
  const torch::NoGradGuard no_grad;
  std::filesystem::create_directories(folder);
  write_training_views(trainer.bank(), folder);
  write_test_views(trainer.dataset(), folder);
  const splat::Gaussians gaussians = trainer.state().gaussians.detached();
  write(folder, "means", gaussians.means);
  write(folder, "rotations", gaussians.rotations);
  write(folder, "log_scales", gaussians.log_scales);
  write(folder, "logit_opacities", gaussians.logit_opacities);
  write(folder, "sh", gaussians.sh);
  const auto& response = trainer.state().response;
  if (response) write(folder, "response", response->table());
  write_file(folder / "training.json", numbers_of(trainer).dump(2) + "\n");
}

}  // namespace jade::bench
